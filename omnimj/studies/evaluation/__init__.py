"""Many randomised runs with a diagnosing method: how often it is right, how soon, and
what its recovery is worth.
"""
