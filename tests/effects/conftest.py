"""Puts this folder on the import path (for `driven_plants`)."""
