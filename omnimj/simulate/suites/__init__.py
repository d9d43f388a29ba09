"""Test plans that are recorded as datasets."""
