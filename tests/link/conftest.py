"""Puts this folder on the import path of its sub-folders, for `device_driver` and the other helpers."""
