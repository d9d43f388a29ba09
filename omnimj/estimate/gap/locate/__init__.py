"""Regimes in which the mismatch concentrates.

- `regimes`: the regimes of every channel, their shares and their descriptions
- `rules`: ranges of one variable that hold most of the mismatch, tested against chance and confounding
- `variables`: the variables that rules are about, and rules in words
"""
