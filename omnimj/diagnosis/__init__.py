"""A diagnosing method over recorded runs: what it says, and thresholds from runs without a fault."""
