"""The navigation of MkDocs; a page that is not in it ends the build of the site."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

TUTORIALS = "tutorials/"
"""Folder of the tutorials."""
NAVIGATION: list[dict[str, Any]] = [
    {"Home": "index.md"},
    {
        "Tutorials": [
            "tutorials/drive_and_break.md",
            "tutorials/csv_to_gap.md",
            "tutorials/own_robot.md",
            "tutorials/own_wheel.md",
            "tutorials/own_controller.md",
            "tutorials/real_robot.md",
        ]
    },
    {
        "How-to": [
            {"Drive": ["howto/run.md", "howto/scenarios.md", "howto/compare.md"]},
            {"Logs": ["howto/record.md", "howto/import.md", "howto/export.md", "logs.md"]},
            {"Gap": ["howto/gap.md", "howto/validate.md", "any_machine.md"]},
            {"Identify": ["howto/identify.md", "own_robot.md"]},
            {"Diagnose": ["howto/diagnose.md", "howto/calibrate.md", "howto/evaluate.md", "many_runs.md"]},
            {"Tune": ["howto/tune.md", "howto/sensitivity.md", "tuning.md"]},
            {
                "Robot on a wire": [
                    "howto/device.md",
                    "howto/link_check.md",
                    "howto/teleop.md",
                    "howto/link_fuzz.md",
                    "hardware.md",
                    "ros2_control.md",
                ]
            },
            {"Wheels of your own": ["howto/wheel.md", "howto/robot.md", "wheels.md"]},
            {"Python and learning": ["python.md", "learning.md"]},
            {
                "This installation": [
                    "howto/completion.md",
                    "howto/bench.md",
                    "howto/report_bug.md",
                    "howto/docs_serve.md",
                    "howto/docs_build.md",
                ]
            },
        ]
    },
    {
        "Extending": [
            "extend/floor.md",
            "extend/scenario.md",
            "extend/effect.md",
            "extend/plant.md",
            "extend/transport.md",
        ]
    },
    {
        "Reference": [
            "commands.md",
            "api.md",
            "scenarios.md",
            "scenario_keys.md",
            "models.md",
            "model_files.md",
            "datasets.md",
            "effects.md",
            "schemas.md",
            "protocol.md",
        ]
    },
    {
        "Explanation": [
            "architecture.md",
            "equations.md",
            "diagnosis.md",
            "recovery.md",
            "gap.md",
            "threats.md",
        ]
    },
    {"Results": ["validation.md", "evaluation.md", "gap_benchmark.md", "real_machines.md"]},
    {"Project": ["changelog.md", "development.md", "cite.md"]},
]
"""Titles and pages, relative to the folder of the documentation, in order."""


def pages(entry: Any = NAVIGATION) -> Iterator[str]:
    """Pages of the navigation, or of one entry of it, in order."""
    if isinstance(entry, str):
        yield entry
    else:
        for below in entry.values() if isinstance(entry, dict) else entry:
            yield from pages(below)
