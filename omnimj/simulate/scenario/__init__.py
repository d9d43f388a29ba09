"""Scenario files and what they ask for."""
