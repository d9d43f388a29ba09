"""Functions for the main jobs: they do what the commands of the same names do, without files and terminal.

Each takes names or paths, reads the files, and returns a record, which a notebook shows as a table and whose
`plot` draws it. Less common options are offered by the packages that do the work.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.diagnosis.calibration import Calibration
from omnimj.diagnosis.calibration import calibrate as calibrate_dataset
from omnimj.diagnosis.logs import read_machine, resolve_method
from omnimj.diagnosis.replay import DiagnosedRuns, DiagnosisConfig, check_config
from omnimj.diagnosis.replay import diagnose as diagnose_dataset
from omnimj.estimate.drives.records import DriveValidation
from omnimj.estimate.drives.validate import validate_drives
from omnimj.estimate.gap.check.acceptance import sound_dataset, sound_logs
from omnimj.estimate.gap.find import find_gap
from omnimj.estimate.identification.identify import identify as identify_dataset
from omnimj.estimate.identification.records import Identification, Validation
from omnimj.estimate.identification.validation import validate as validate_dataset
from omnimj.estimate.rig_runs import DISSERTATION_TABLE, FLOOR_FRICTION, require_rig
from omnimj.estimate.robot.identify import identify_robot, require_robot
from omnimj.estimate.robot.records import RobotIdentification
from omnimj.parameters import Floor, read_rig, read_robot
from omnimj.parameters.floor import all_floors, own_floors
from omnimj.recording.dataset import Dataset
from omnimj.recording.read_dataset import read_dataset
from omnimj.simulate.detectors import default_method
from omnimj.simulate.run import RunResult, run_scenario
from omnimj.simulate.scenario.scenario import Scenario, read_scenario
from omnimj.simulate.suites.catalogue import find_suite
from omnimj.simulate.suites.recording import RecordingConfig, record_suite

if TYPE_CHECKING:
    from omnimj.studies.evaluation.study import EvaluationConfig, EvaluationResult
    from omnimj.studies.tuning.study import TuningConfig, TuningResult

__all__ = [
    "calibrate",
    "diagnose",
    "evaluate",
    "find_gap",
    "identify",
    "record",
    "run",
    "tune",
    "validate",
]

Report = Callable[[str, float], None]
"""Called with a phrase and the share of the work that is done, 0 … 1."""


def run(
    scenario: str | Path | Scenario,
    plant: str | None = None,
    method: str | None = None,
    seed: int = 0,
    overrides: Sequence[str] = (),
    model: Path | str | None = None,
    floors: Path | str | None = None,
) -> RunResult:
    """Drive a scenario once and judge it by its checks.

    Args:
      scenario: Name of a shipped one, path of a TOML file, or a scenario that was read before.
      plant: `twin` (default), `planar`, or the address of a device.
      method: Diagnosis: `robust` (default on the robot), `published` (default on the rig) or `off`.
      seed: Seed of the sensors' noise.
      overrides: `KEY=VALUE` texts, such as `floor=pvc`.
      model: Model file of the plant; the shipped one when None.
      floors: Floors beside the shipped ones, or in their place where names are alike.

    Returns:
      Trace, metrics (the content of `metrics.json`) and poses.

    Raises:
      InputError: A value is missing or breaks its rule.
      UnknownNameError: No such scenario, floor, plant or method.
    """
    read = scenario
    if not isinstance(read, Scenario):
        read = read_scenario(read, overrides, _path(model), _path(floors))
    return run_scenario(read, plant, default_method(read) if method is None else method, seed)


def record(
    suite: str,
    out: Path | str,
    seed: int = 0,
    repeats: int | None = None,
    plant: str | None = None,
    model: Path | str | None = None,
    effects: Mapping[str, Mapping[str, Any]] | None = None,
) -> Dataset:
    """Record a test plan with a simulated plant, as a data logger would.

    Args:
      suite: Name of the test plan, such as `rig_mixed`.
      out: Folder of the dataset, new or empty.
      seed: Seed of the sensors' noise and of random conditions.
      repeats: Repeats of every condition; the suite's own number when None.
      plant: `twin` or `planar`; the suite's own when None.
      model: Model file of the plant; the shipped one when None.
      effects: Effects that the machine has and its model file lacks, name to parameters.

    Returns:
      The dataset, read back from its folder.

    Raises:
      InputError: The folder is not empty or cannot be written, or a value breaks its rule.
      UnknownNameError: No such suite, plant or effect.
      SimulationError: The simulation failed; runs finished before are kept.
    """
    config = RecordingConfig(Path(out), seed, repeats, plant, _path(model), effects=effects or {})
    record_suite(find_suite(suite), config)
    return read_dataset(config.folder)


def identify(
    dataset: Path | str | Dataset, model: Path | str | None = None, accept: bool = False
) -> Identification | RobotIdentification:
    """Identify the floors of rig runs, or a robot from its healthy drives, with intervals.

    Args:
      dataset: Folder of the runs, or the dataset itself.
      model: Model file of the rig or the robot; the shipped one when None.
      accept: Whether to go on with data that have certain faults; gross units are then corrected.

    Returns:
      LuGre parameters of each floor of rig runs; of a robot its motors, losses, masses, sensors and floors.

    Raises:
      InputError: Another machine, or too little moves in the runs.
      DataFaultError: The data have certain faults and are not accepted.
    """
    read = _dataset(dataset)
    if read.plant == "uto_robot":
        robot = read_robot(model)
        require_robot(read, robot)
        return identify_robot(sound_dataset(read, robot, accept)[0], robot)
    rig = read_rig(model)
    require_rig(read, FLOOR_FRICTION)
    sound, _ = sound_dataset(read, rig, accept)
    return identify_dataset(sound, rig)


def validate(
    dataset: Path | str | Dataset,
    model: Path | str | None = None,
    floors: Path | str | None = None,
    plants: Sequence[str] = ("twin", "planar"),
    accept: bool = False,
) -> Validation | DriveValidation:
    """Drive the model as measured: a rig by its currents, a robot by its wheel speeds; compare the motion.

    Args:
      dataset: Folder of rig runs, or of a robot's drives with a measured pose, or the dataset itself.
      model: Model file; the shipped one when None.
      floors: Floors beside the shipped ones, or in their place where names are alike.
      plants: Models that are driven, of `twin` and `planar`.
      accept: Whether to go on with rig data that have certain faults; gross units are then corrected.

    Returns:
      `Validation` of a rig, `DriveValidation` of a robot.

    Raises:
      DataFaultError: The data have certain faults and are not accepted.
      InputError: A dataset of another plant or without a measured pose, or a floor or mass that it cannot
        have.
      UnknownNameError: No such plant.
      SimulationError: The simulation left finite numbers.
    """
    known = all_floors(floors)
    read = _dataset(dataset, known)
    if read.plant == "uto_robot":
        robot = read_robot(model)
        return validate_drives(read, robot, known, plants)
    rig = read_rig(model)
    require_rig(read, DISSERTATION_TABLE)
    sound, _ = sound_dataset(read, rig, accept)
    return validate_dataset(sound, rig, known, plants)


def diagnose(
    dataset: Path | str | Dataset,
    method: str | None = None,
    model: Path | str | None = None,
    floors: Path | str | None = None,
    thresholds: Thresholds | None = None,
    accept: bool = False,
) -> DiagnosedRuns:
    """Diagnose recorded runs of the robot or the rig, without any plant.

    Args:
      dataset: Folder of the runs, or the dataset itself.
      method: `robust` (default on the robot) or `published` (default on the rig).
      model: Model file of the machine; the shipped one when None.
      floors: Floors beside the shipped ones, or in their place where names are alike; the
        robust method expects their creep and drag.
      thresholds: Thresholds of the robust method; the shipped ones when None.
      accept: Whether to go on with logs in which time, a unit or a sign is wrong throughout.

    Returns:
      A tuple with one record per run: its diagnoses, and a trace with the method's columns.

    Raises:
      InputError: The method is not for this machine, or a run is sampled too slowly.
      DataFaultError: Time, a unit or a sign is wrong in all of the logs, and they are not accepted.
      UnknownNameError: No such method.
    """
    config = _diagnosis(dataset, method, model, floors, thresholds)
    sound, _ = sound_logs(config.dataset, config.machine.constants, accept)
    config = replace(config, dataset=sound)
    check_config(config)
    return DiagnosedRuns(diagnose_dataset(config))


def calibrate(
    dataset: Path | str | Dataset,
    false_alarms_per_hour: float,
    model: Path | str | None = None,
    floors: Path | str | None = None,
    accept: bool = False,
) -> Calibration:
    """Set the thresholds of the robust method from fault-free recordings of the robot.

    Args:
      dataset: Folder of the runs, or the dataset itself.
      false_alarms_per_hour: Rate of false alarms per hour of motion, all thresholds together; above 0.
      model: Model file of the robot; the shipped one when None.
      floors: Floors beside the shipped ones, or in their place where names are alike; the
        method expects their creep and drag.
      accept: Whether to go on with data that have certain faults; gross units are then corrected.

    Raises:
      InputError: There is too little motion, or a sensor has obviously failed.
      DataFaultError: The data have certain faults and are not accepted.
    """
    config = _diagnosis(dataset, "robust", model, floors, None)
    sound, _ = sound_dataset(config.dataset, config.machine.constants, accept)
    config = replace(config, dataset=sound)
    check_config(config)
    return calibrate_dataset(config, false_alarms_per_hour)


def evaluate(
    config: EvaluationConfig, report: Report | None = None, executor: Executor | None = None
) -> EvaluationResult:
    """Drive many random cases with a method and judge its diagnoses and its recovery.

    Args:
      config: Folder, method, number of trials and what the cases are drawn from.
      report: Called while it runs; it may raise KeyboardInterrupt, which keeps the finished cases.
      executor: Runs the cases; own processes when None.

    Raises:
      InputError: The folder holds something else or another evaluation.
      UnknownNameError: No such suite, plant, floor, method or class of faults.
      SimulationError: A worker died; finished trials are kept.
    """
    from omnimj.studies.evaluation.study import run_evaluation

    return run_evaluation(config, report or _silent, executor)


def tune(
    config: TuningConfig, report: Report | None = None, executor: Executor | None = None
) -> TuningResult | None:
    """Search the gains of cascade, recovery and observer, and judge the result on other seeds.

    Args:
      config: Scenarios, gains, bounds, seed and size of the search.
      report: Called while it runs; it may raise KeyboardInterrupt, which keeps the finished trials.
      executor: Runs the trials; own processes when None.

    Returns:
      The tuned gains with their scores; None when it was interrupted.

    Raises:
      InputError: The folder beside the file holds something else, or a name or bound is wrong.
      SimulationError: A worker died or a trial failed; finished trials are kept.
    """
    from omnimj.studies.tuning.study import run_tuning

    return run_tuning(config, report or _silent, executor)


def _silent(_phrase: str, _share: float) -> None:
    pass


def _path(given: Path | str | None) -> Path | None:
    return None if given is None else Path(given)


def _dataset(dataset: Path | str | Dataset, floors: Mapping[str, Floor] | None = None) -> Dataset:
    return dataset if isinstance(dataset, Dataset) else read_dataset(dataset, floors)


def _diagnosis(
    dataset: Path | str | Dataset,
    method: str | None,
    model: Path | str | None,
    floors: Path | str | None,
    thresholds: Thresholds | None,
) -> DiagnosisConfig:
    known, expected = all_floors(floors), own_floors(floors)
    read = _dataset(dataset, known)
    machine = read_machine(read, model)
    method = resolve_method(method, machine)
    return DiagnosisConfig(read, machine, method, known, thresholds, expected_floors=expected)
