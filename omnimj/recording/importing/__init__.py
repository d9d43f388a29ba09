"""Logs of other programs as datasets."""
