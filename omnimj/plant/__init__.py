"""What a plant is, its sensors and its faults, and the plants that need no MuJoCo."""
