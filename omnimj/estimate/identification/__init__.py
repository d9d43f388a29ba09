"""Traction parameters from rig runs, and tables of simulated against measured."""
