"""The real robot behind a wire: frames, links, the device's rules and the emulated device."""
