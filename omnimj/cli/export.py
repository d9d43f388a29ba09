"""`omnimj export`: a run as a file of another tool."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from omnimj.cli.arguments import Command, require_writable

FORMATS = ("mcap", "csv", "mat")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj export`."""
    words = "folder of a run, its trace.parquet, or a run of a dataset (DATASET/NAME.parquet)"
    parser.add_argument("run_path", metavar="RUN", type=Path, help=words)
    words = "mcap (Foxglove, PlotJuggler, ROS 2), csv, or mat (MATLAB)"
    parser.add_argument("--to", metavar="FORMAT", dest="format", required=True, choices=FORMATS, help=words)
    words = "file to write (default: beside the run's table, with the suffix of the format)"
    parser.add_argument("--out", metavar="FILE", type=Path, help=words)
    parser.add_argument("--force", action="store_true", help="replace FILE")


def run(arguments: Any) -> int:
    """Read a run and write it in another format."""
    from omnimj.recording.exporting.files import write_csv, write_mat
    from omnimj.recording.exporting.messages import write_mcap
    from omnimj.recording.exporting.source import read_run
    from omnimj.recording.folder import make_parents

    found = read_run(arguments.run_path)
    out = arguments.out or found.file.with_suffix(f".{arguments.format}")
    require_writable(out, arguments.force)
    make_parents(out, f"--out {out}")
    write = {"mcap": write_mcap, "csv": write_csv, "mat": write_mat}[arguments.format]
    write(out, found)
    rows = len(found.columns["time"])
    print(f"{len(found.columns)} columns, {rows} rows written to {out}")
    return 0


EXPORT = Command(
    "export",
    "export a run for other tools: MCAP for Foxglove and PlotJuggler, CSV, MATLAB",
    """No column is lost; units go along. MCAP needs the libraries of the extra omnimj[import].

examples:
  omnimj export out/nylon --to mcap
  omnimj export out/nylon --to mat --out nylon.mat
  omnimj export data/rig/pvc_1959g_long.parquet --to csv --out long.csv""",
    add_arguments,
    run,
)
