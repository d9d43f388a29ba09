"""MuJoCo twin of a four-wheel omni robot and its test rig, with faults, diagnosis and the gap to measurement.

The names below are the public interface; they load on first use, so that `import omnimj` takes no time.

    import omnimj

    result = omnimj.run("nylon_patch")                # drive a scenario on the twin and judge it
    result.trace["time"], result.metrics["passed"]

    finding = omnimj.find_gap("data/lateral")         # what does the model lack, given measured runs?
    finding.verdict, finding.effects

    twin = omnimj.RobotTwin(omnimj.read_robot(), omnimj.read_floors()["pvc"])    # or step it yourself
    measurement = twin.reset()

The packages, and what happens in one control step, are described in `omnimj/docs/architecture.md`.
Every error that omnimj raises on purpose is an `OmnimjError`. Units are SI throughout.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from omnimj.control.cascade.controller import Controller
    from omnimj.control.compiled import CompiledController
    from omnimj.control.detection.detector import FaultDetector
    from omnimj.control.detection.robust.detector import RobustDetector
    from omnimj.control.detection.robust.thresholds import Thresholds
    from omnimj.control.fault_tolerant import FaultTolerantController
    from omnimj.control.gains import Gains
    from omnimj.diagnosis.calibration import Calibration
    from omnimj.diagnosis.replay import RunDiagnosis
    from omnimj.errors import DataFaultError, InputError, OmnimjError, SimulationError
    from omnimj.estimate.gap.records import Finding
    from omnimj.estimate.identification.records import Identification, Validation
    from omnimj.parameters import Floor, Rig, Robot, read_floors, read_rig, read_robot
    from omnimj.plant.interface import Plant
    from omnimj.plant.mujoco.twin import RigTwin, RobotTwin
    from omnimj.plant.planar import PlanarRobot
    from omnimj.plant.planar_rig import PlanarRig
    from omnimj.recording.dataset import Dataset
    from omnimj.recording.read_dataset import read_dataset
    from omnimj.recording.traces import read_trace, write_trace
    from omnimj.signals import CurrentCommand, Diagnosis, Measurement, RigMeasurement, Target, Trace
    from omnimj.simulate.run import RunResult
    from omnimj.simulate.scenario.listing import list_scenarios
    from omnimj.simulate.scenario.scenario import Scenario, read_scenario
    from omnimj.studies.evaluation.study import EvaluationConfig, EvaluationResult
    from omnimj.studies.tuning.study import TuningConfig, TuningResult
    from omnimj.workflows import (
        calibrate,
        diagnose,
        evaluate,
        find_gap,
        identify,
        record,
        run,
        tune,
        validate,
    )

__version__ = "0.3.0"

_HOMES = {
    "omnimj.workflows": (
        "run",
        "record",
        "identify",
        "validate",
        "find_gap",
        "diagnose",
        "calibrate",
        "evaluate",
        "tune",
    ),
    "omnimj.parameters": ("read_robot", "read_rig", "read_floors", "Robot", "Rig", "Floor"),
    "omnimj.plant.interface": ("Plant",),
    "omnimj.plant.mujoco.twin": ("RobotTwin", "RigTwin"),
    "omnimj.plant.planar": ("PlanarRobot",),
    "omnimj.plant.planar_rig": ("PlanarRig",),
    "omnimj.control.cascade.controller": ("Controller",),
    "omnimj.control.compiled": ("CompiledController",),
    "omnimj.control.fault_tolerant": ("FaultTolerantController",),
    "omnimj.control.detection.detector": ("FaultDetector",),
    "omnimj.control.detection.robust.detector": ("RobustDetector",),
    "omnimj.control.detection.robust.thresholds": ("Thresholds",),
    "omnimj.control.gains": ("Gains",),
    "omnimj.signals": ("Measurement", "RigMeasurement", "CurrentCommand", "Target", "Diagnosis", "Trace"),
    "omnimj.simulate.scenario.listing": ("list_scenarios",),
    "omnimj.simulate.scenario.scenario": ("read_scenario", "Scenario"),
    "omnimj.simulate.run": ("RunResult",),
    "omnimj.recording.traces": ("read_trace", "write_trace"),
    "omnimj.recording.read_dataset": ("read_dataset",),
    "omnimj.recording.dataset": ("Dataset",),
    "omnimj.estimate.gap.records": ("Finding",),
    "omnimj.estimate.identification.records": ("Identification", "Validation"),
    "omnimj.diagnosis.replay": ("RunDiagnosis",),
    "omnimj.diagnosis.calibration": ("Calibration",),
    "omnimj.studies.evaluation.study": ("EvaluationConfig", "EvaluationResult"),
    "omnimj.studies.tuning.study": ("TuningConfig", "TuningResult"),
    "omnimj.errors": ("OmnimjError", "InputError", "DataFaultError", "SimulationError"),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}

__all__ = ["__version__", *_HOME]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    """Load a public name from its module on first use."""
    if name not in _HOME:
        raise AttributeError(f"module 'omnimj' has no attribute {name!r}")
    found = getattr(import_module(_HOME[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    """List the public names for completion, loaded or not."""
    return sorted({*globals(), *__all__})
