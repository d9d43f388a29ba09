"""`omnimj compare`: runs side by side on one page, or the index of a folder of runs."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import Command, command_line, has_out, require_writable
from omnimj.cli.terminal import format_json, format_table, print_result
from omnimj.errors import InputError

if TYPE_CHECKING:
    from omnimj.recording.run_folder import RunFolder
    from omnimj.view.comparison import Comparison


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `omnimj compare`."""
    words = "folder of a run, from omnimj run --out; a single folder that holds runs gets an index"
    parser.add_argument("runs", metavar="RUN", type=Path, nargs="+", help=words)
    words = "write the page here: tables and overlaid plots, or the index"
    parser.add_argument("--out", metavar="FILE", type=Path, help=words)
    parser.add_argument("--force", action="store_true", help="replace --out if it exists")
    parser.add_argument("--json", action="store_true", help="print the tables as JSON")


def run(arguments: Any) -> int:
    """Compare runs, or list those of a folder."""
    from omnimj.recording.run_folder import is_run_folder

    if has_out(arguments, "FILE"):
        require_writable(arguments.out, arguments.force)
    if len(arguments.runs) == 1 and not is_run_folder(arguments.runs[0]):
        return _list_runs(arguments)
    return _compare(arguments)


def _compare(arguments: Any) -> int:
    from omnimj.recording.run_folder import read_run_folder, short_names
    from omnimj.view.comparison import compare_runs
    from omnimj.view.report.comparison import MOST_RUNS, write_comparison

    if not 1 < len(arguments.runs) <= MOST_RUNS:
        rule = f"two to {MOST_RUNS} runs can be compared; a folder that holds runs gets an index"
        raise InputError("RUN", f"found {len(arguments.runs)}", rule)
    names = short_names(arguments.runs)
    for name in names:
        if names.count(name) > 1:
            raise InputError("RUN", f"{name} is given twice", "each run is given once")
    found = {name: read_run_folder(path) for name, path in zip(names, arguments.runs, strict=True)}
    comparison = compare_runs({name: one.metrics for name, one in found.items()})
    traces = {name: one.trace() for name, one in found.items()} if arguments.out is not None else {}
    print_result(format_json(_content(comparison)) if arguments.json else _format(comparison))
    if arguments.out is not None:
        runs = {name: (one.metrics, traces[name]) for name, one in found.items()}
        _write(arguments, lambda page: write_comparison(page, runs, command_line(arguments)))
    return 0


def _write(arguments: Any, write_page: Callable[[Path], None]) -> None:
    from omnimj.recording.folder import atomic_file, make_parents

    make_parents(arguments.out, f"--out {arguments.out}")
    with atomic_file(arguments.out) as temporary:
        write_page(temporary)
    if not arguments.json:
        print(f"written to {arguments.out}")


def _content(comparison: Comparison) -> dict[str, Any]:
    def by_run(rows: tuple[tuple[str, ...], ...]) -> dict[str, dict[str, str]]:
        return {name: dict(zip(comparison.names, texts, strict=True)) for name, *texts in rows}

    return {
        "runs": list(comparison.names),
        "differing": list(comparison.differing),
        "setup": by_run(comparison.setup),
        "checks": by_run(comparison.checks),
        "results": by_run(comparison.rows),
    }


def _format(comparison: Comparison) -> str:
    head = ("", *comparison.names)
    setup = [row for row in comparison.setup if row[0] in comparison.differing or row[0] == "scenario"]
    tables = [format_table(head, rows) for rows in (setup, comparison.checks, comparison.rows) if rows]
    return "\n\n".join(tables)


def _list_runs(arguments: Any) -> int:
    from omnimj.recording.run_folder import find_run_folders
    from omnimj.view.report.comparison import INDEX_HEAD, index_texts, write_index

    (folder,) = arguments.runs
    if not folder.is_dir():
        raise InputError(folder, "is not a folder", "a folder of runs is needed")
    runs = find_run_folders(folder)
    names = [one.path.relative_to(folder).as_posix() for one in runs]
    if arguments.json:
        print_result(format_json({name: _row(one) for name, one in zip(names, runs, strict=True)}))
    else:
        rows = [(name, *index_texts(one.metrics)) for name, one in zip(names, runs, strict=True)]
        print_result(format_table(("run", *INDEX_HEAD), rows))
    if arguments.out is not None:
        _write(arguments, lambda page: write_index(page, folder, runs))
    return 0


def _row(run: RunFolder) -> dict[str, Any]:
    names = ("scenario", "plant", "method", "floor", "seed", "passed", "detection_delay", "false_alarms")
    return {name: run.metrics.get(name) for name in names}


COMPARE = Command(
    "compare",
    "compare runs on one page, or list a folder of runs",
    """examples:
  omnimj compare out/robust out/off --out out/comparison.html
  omnimj compare out --out out/index.html""",
    add_arguments,
    run,
)
