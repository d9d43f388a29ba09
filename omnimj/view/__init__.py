"""Rerun recordings, plots, reports."""
