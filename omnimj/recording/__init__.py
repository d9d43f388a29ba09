"""Traces and datasets to and from files."""
