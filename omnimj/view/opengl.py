"""Choice of the OpenGL that MuJoCo renders with, before MuJoCo is imported."""

from __future__ import annotations

import ctypes.util
import os
import sys


def choose_backend() -> None:
    """Set MUJOCO_GL to software rendering where no window system is running and Mesa's library is installed.

    Does nothing when MuJoCo is already imported, since it has chosen then.
    """
    if "mujoco" in sys.modules:
        return
    has_windows = any(os.environ.get(name) for name in ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY"))
    if sys.platform == "linux" and not has_windows and ctypes.util.find_library("OSMesa"):
        os.environ["MUJOCO_GL"] = "osmesa"
