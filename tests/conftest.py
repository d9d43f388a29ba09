"""Shared by all tests; its place also puts this folder on the import path (for `rig_reference`)."""

from __future__ import annotations

from hypothesis import settings

# a kernel compiles on its first call, which says nothing about the example at hand
settings.register_profile("kernels", deadline=None)
settings.load_profile("kernels")
