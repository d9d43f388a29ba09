"""Command line `omnimj`: one file per command or family of commands.

`main` holds the parser, exit codes and one-line errors; `terminal` robust streams, progress bar, tables;
`arguments` the `Command` record and shared options. The commands:

- `run` (`scenarios`, `run`), with `run_summary` for what it prints; `teleop`
- `record`; `identify` (`identify`, `validate`); `gap` (with its benchmark)
- `diagnose` (`diagnose`, `calibrate`); `studies` (`evaluate`, `sensitivity`); `tune`
- `link` (`link check`, `link fuzz`); `device`
- `bench`, `completion`

Modules import their libraries inside functions, so that `omnimj --help` starts at once.
"""
