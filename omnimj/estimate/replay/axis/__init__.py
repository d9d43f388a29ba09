"""Axis."""
