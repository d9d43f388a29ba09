"""Scenario files.

- `scenario`: the record of a scenario, read from its TOML file.
- `drive`, `motion`: the `[drive]` table as a reference, and the planned motions of each kind.
- `tables`: single entries and small tables; `checks`: bounds on the metrics.
- `overrides`: `--set KEY=VALUE`, and the keys that exist.
- `listing`: the shipped scenarios.
"""
