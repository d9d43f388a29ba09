"""`omnimj bench` reports what its schema requires."""

import contextlib
import io
import json
import math
from pathlib import Path

import jsonschema
import pytest

from omnimj.cli import bench
from omnimj.cli.main import main
from omnimj.estimate.gap.find import find_gap

SCHEMA = json.loads((Path(__file__).parent.parent / "schema" / "bench.json").read_text())


MEASURED = (
    "omnimj.bench.control.measure_control",
    "omnimj.bench.gap.measure_gap",
    "omnimj.bench.learning.measure_environments",
    "omnimj.bench.link.measure_link",
    "omnimj.bench.control.measure_logs",
    "omnimj.bench.twin.measure_driving",
    "omnimj.bench.twin.measure_run",
    "omnimj.bench.twin.measure_threads",
    "omnimj.bench.twin.measure_twin",
)

DEAR = {
    "omnimj.bench.control.measure_control": (
        "control_step_median_us",
        "control_step_p999_us",
        "control_growth_kb_per_hour",
        "control_growth_hours",
    ),
    "omnimj.bench.gap.measure_gap": (
        "gap_rig_seconds",
        "gap_simulation_ratio",
        "gap_axis_seconds",
        "gap_axis_log_seconds",
    ),
    "omnimj.bench.twin.measure_driving": (
        "unit_step_us",
        "unit_spread",
        "diagnosed_step_ratio",
        "undiagnosed_step_ratio",
        "stepwise_step_ratio",
        "diagnosed_twin_to_planar_ratio",
    ),
    "omnimj.bench.twin.measure_threads": ("two_threads_speedup", "two_cores_speedup"),
}
"""Parts that compile and drive for long, and their figures."""


def once(function):
    """The same finding for the same folder: a search that is timed again takes no time."""
    found = {}

    def first(folder, **options):
        if folder not in found:
            found[folder] = function(folder, **options)
        return found[folder]

    return first


def printed_json() -> dict[str, float]:
    """Figures of a short measurement, as JSON prints them."""
    effort = bench.Effort(
        steps=100,
        rounds=1,
        drive=3.0,
        drives=2,
        run=1.0,
        missions=1,
        mission=3.0,
        hours=1e-3,
        log=3.0,
        gap_runs=4,
        gap_axis_runs=1,
        frames=50,
        trips=300,
        decisions=2,
        decision_rounds=2,
    )
    printed = io.StringIO()
    with pytest.MonkeyPatch.context() as patched, contextlib.redirect_stdout(printed):
        patched.setattr(bench, "EFFORT", effort)
        patched.setattr("omnimj.bench.gap.find_gap", once(find_gap))
        assert main(["bench", "--json"]) == 0
    return json.loads(printed.getvalue())


def check_figures(found: dict[str, float]) -> None:
    """They keep to the schema, and each is positive but for those of growth."""
    jsonschema.validate(found, SCHEMA)
    figures = dict(found)
    grown = [figures.pop(name) for name in found if name.endswith("kb_per_hour")]
    assert figures["udp_round_trip_ratio"] > 1.0 and "codec_decode_us" in figures
    assert all(value > 0.0 for value in figures.values()) and grown and all(map(math.isfinite, grown))


@pytest.mark.slow
def test_json_keeps_to_the_schema_and_every_figure_is_positive():
    check_figures(printed_json())


@pytest.mark.slow
def test_json_holds_the_figures_of_the_parts_whose_kernels_are_few(monkeypatch):
    for place, names in DEAR.items():
        monkeypatch.setattr(place, lambda *_, names=names: dict.fromkeys(names, 1.0))
    check_figures(printed_json())


def test_the_table_explains_every_figure(monkeypatch, capsys):
    figures = (*SCHEMA["required"], "control_growth_kb_per_hour")
    for place in MEASURED:
        monkeypatch.setattr(place, lambda *_: dict.fromkeys(figures, 1.0))
    assert main(["bench"]) == 0
    table = capsys.readouterr().out
    for name in figures:
        assert name in table
