"""`omnimj gap`: finds where simulation and measurement part, names what is missing, adds it, shows it."""

from __future__ import annotations

import argparse
import json
import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import add_floors, names, whole_number
from omnimj.cli.gap_benchmark import add_benchmark_arguments, run_gap_benchmark
from omnimj.cli.progress import ProgressBar
from omnimj.errors import InputError, SimulationError

if TYPE_CHECKING:
    from omnimj.gap.records import Finding

HELP = "find what the model lacks: where it parts from measured runs, by which effect, and how sure that is"
EXAMPLE = """examples:
  omnimj gap data/lateral --out out/lateral
  omnimj gap data/axis --model my_axis.toml --holdout sine_07,slow --out out/axis
  omnimj validate data/lateral --model out/lateral/model.toml --out out/after
  omnimj gap --benchmark --seed 100 --workers 2 --out out/benchmark"""
_INTERRUPTED = "interrupted"
_FINE = 1000  # steps of the progress bar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the sub-command."""
    parser.add_argument("dataset", type=Path, nargs="?", help="the folder with the measured runs")
    parser.add_argument(
        "--model", metavar="FILE", type=Path, help="the plant's model file; the shipped one by default"
    )
    add_floors(parser)
    parser.add_argument(
        "--holdout",
        metavar="NAMES",
        type=names,
        default=(),
        help="runs or conditions to judge by, comma separated; drawn by the seed by default",
    )
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="where the result goes")
    parser.add_argument("--force", action="store_true", help="write into --out although it is not empty")
    parser.add_argument("--json", action="store_true", help="print gap.json instead of the tables")
    parser.add_argument(
        "--seed",
        metavar="N",
        type=whole_number(0, 2**63 - 1),
        default=0,
        help="of what is held out and of the random curves, or of the benchmark (default 0)",
    )
    add_benchmark_arguments(parser)


def run(arguments: Any) -> int:
    """Searches, writes, prints.

    Returns:
      0 whatever the verdict, 130 after Ctrl-C with what was found until then.

    Raises:
      InputError: The dataset, the model file or a name is wrong, or the folder cannot be written.
      SimulationError: The search broke down; what was found until then is written.
    """
    # the matrices are small: a library's threads would only wait for each other
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from omnimj.recording.folder import check_folder

    if arguments.benchmark:
        return run_gap_benchmark(arguments)
    check_folder(arguments.out, arguments.force)
    _check_files(arguments.out)
    if arguments.dataset is None:
        raise InputError("omnimj gap", "DATASET is missing", "see omnimj gap --help")
    finding = _search(arguments)
    return _deliver(arguments, finding)


def _check_files(folder: Path) -> None:
    """Asked before the search, so that no work is lost."""
    from omnimj.cli.gap_outputs import FILES

    for name in FILES:
        if (folder / name).is_dir():
            raise InputError(f"--out {folder}", f"has a folder {name}", "a file will go there")


def _report_to(bar: ProgressBar):
    return lambda phase, share: bar.show(round(_FINE * min(max(share, 0.0), 1.0)), _FINE, phase)


def _search(arguments: Any) -> Finding:
    from omnimj.gap.engine import find_gap

    with ProgressBar() as bar:
        return find_gap(
            arguments.dataset,
            arguments.model,
            arguments.holdout,
            _report_to(bar),
            arguments.seed,
            arguments.floors,
        )


def _new_texts(arguments: Any, finding: Finding) -> tuple[dict[str, str], InputError | None]:
    """The new model and the refitted floors; or why there are none, to be said when all else is written."""
    from omnimj.cli.gap_outputs import FLOORS, MODEL
    from omnimj.gap.new_model import new_floors_text, new_model_text
    from omnimj.parameters.floor import all_floors

    try:
        texts = {
            MODEL: new_model_text(finding, arguments.model),
            FLOORS: new_floors_text(finding, all_floors(arguments.floors)),
        }
    except InputError as error:
        return {}, error
    return {name: text for name, text in texts.items() if text is not None}, None


def _deliver(arguments: Any, finding: Finding) -> int:
    """Writes and prints what was found, whatever ended the search."""
    from omnimj.cli.gap_outputs import told, write_outputs

    command = shlex.join(["omnimj", *arguments.given])
    texts, refused = _new_texts(arguments, finding)
    content = write_outputs(arguments.out, arguments.force, finding, arguments.model, command, texts)
    if refused is not None:
        raise refused
    if finding.failure and finding.failure != _INTERRUPTED:
        raise SimulationError(f"{finding.failure}; what was found until then is in {arguments.out}")
    if arguments.json:
        print(json.dumps(content, indent=2, ensure_ascii=False))
    else:
        print(told(finding, arguments.out, content))
    return 130 if finding.failure else 0
