"""Tuning: gains of cascade, recovery and observer, found over a batch of randomised runs."""
