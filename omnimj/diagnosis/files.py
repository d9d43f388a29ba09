"""Files of diagnosis and calibration: `diagnoses.json`, `thresholds.toml` and sentences on both."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import omnimj
from omnimj.control.detection.robust.thresholds import THRESHOLD_UNITS, Thresholds
from omnimj.diagnosis.calibration import ADVISED_HOURS, Calibration
from omnimj.diagnosis.detectable_loss import HORIZON, LOSSES, DetectableLoss
from omnimj.diagnosis.model_misfit import ModelMisfit, RaisedThreshold
from omnimj.diagnosis.replay import DiagnosisConfig, RunDiagnosis
from omnimj.recording.dataset import Dataset
from omnimj.recording.json_files import to_jsonable, write_text
from omnimj.signals import Diagnosis


def diagnoses_json(
    config: DiagnosisConfig, found: Sequence[RunDiagnosis], command: str, interrupted: bool
) -> dict[str, Any]:
    """Return the content of `diagnoses.json`.

    Args:
      config: Settings of the diagnosis.
      found: Finished runs.
      command: Command line that repeats the diagnosis.
      interrupted: True if runs are missing.
    """
    return {
        "dataset": str(config.dataset.path),
        "plant": config.dataset.plant,
        "model": str(config.machine.constants.file),
        "method": config.method,
        "thresholds": None if config.thresholds is None else config.thresholds._asdict(),
        "observer": None if config.observer is None else dataclasses.asdict(config.observer),
        "expected_floors": sorted(config.expected_floors) if config.method == "robust" else [],
        "version": omnimj.__version__,
        "command": command,
        "interrupted": interrupted,
        "notes": list(config.dataset.notes),
        "runs": {
            one.name: {
                "diagnoses": [diagnosis_record(diagnosis) for diagnosis in one.diagnoses],
                "cannot_judge": one.cannot_judge,
                "does_not_fit": None if one.does_not_fit is None else dataclasses.asdict(one.does_not_fit),
                "withheld": [diagnosis_record(diagnosis) for diagnosis in one.withheld],
                "judged": one.judged,
                "notes": list(one.notes),
            }
            for one in found
        },
    }


def diagnosis_record(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return a diagnosis as JSON-compatible values, with None for NaN."""
    return to_jsonable(dataclasses.asdict(diagnosis))


def calibration_json(found: Calibration, dataset: Dataset, command: str) -> dict[str, Any]:
    """Return the calibration as `--json` prints it."""
    usual = Thresholds()
    return {
        "dataset": str(dataset.path),
        "false_alarms_per_hour": found.rate,
        "hours": found.hours,
        "extrapolated": found.extrapolated,
        "runs": found.runs,
        "floors": list(found.floors),
        "thresholds": {
            one.name: {
                "value": one.value,
                "unit": THRESHOLD_UNITS[one.name],
                "shipped": getattr(usual, one.name),
                "largest": one.tail.largest,
                "tail": one.tail.slope,
                "floor": one.floor,
            }
            for one in found.set
        },
        "still_diagnosed": dict(found.remaining),
        "misfit": None if found.misfit is None else to_jsonable(dataclasses.asdict(found.misfit)),
        "warnings": calibration_warnings(found),
        "version": omnimj.__version__,
        "command": command,
    }


def thresholds_toml(found: Calibration, dataset: Dataset, command: str) -> str:
    """Return the content of `thresholds.toml`; every number is read back exactly."""
    lines = ["# Thresholds of the robust method from fault-free recordings; the others are as shipped."]
    lines += [f"# {words}" for words in format_calibration(found)]
    lines += ["", "[thresholds]"]
    for one in found.set:
        unit = THRESHOLD_UNITS[one.name]
        lines.append(f'{one.name} = {{ value = {one.value!r}, unit = "{unit}", source = "measured" }}')
    lines += [
        "",
        "[calibration]",
        f"false_alarms_per_hour = {found.rate!r}",
        f"hours = {found.hours!r}",
        f"runs = {found.runs}",
        f"dataset = {_quoted(str(dataset.path))}",
        f"version = {_quoted(omnimj.__version__)}",
        f"command = {_quoted(command)}",
    ]
    for key, value in (("largest", "largest"), ("tail", "slope"), ("floor", None)):
        lines += ["", f"[calibration.{key}]"]
        for one in found.set:
            number = one.floor if value is None else getattr(one.tail, value)
            lines.append(f"{one.name} = {float(number)!r}")
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    """Return a basic TOML string, whose escapes include those of JSON."""
    return json.dumps(text).replace("\x7f", "\\u007f")


def format_calibration(found: Calibration) -> list[str]:
    """Describe the reliability of calibrated thresholds, one sentence each."""
    once = f"one in {1.0 / found.rate:.3g} h"
    if found.extrapolated <= 1.0:
        reach = "the recordings are longer than that"
    else:
        reach = f"extrapolated {found.extrapolated:.3g}-fold along exponential tails"
    where = f"they hold for conditions like the recorded ones, here on {', '.join(found.floors)}, not beyond"
    goal = f"{found.rate:g} false alarms per hour of motion ({once})"
    sentences = [f"{goal} from {found.hours:.3g} h of motion: {reach}", where, *calibration_warnings(found)]
    return sentences if found.misfit is None else [*sentences, *describe_misfit(found.misfit)]


def describe_misfit(misfit: ModelMisfit) -> list[str]:
    """Describe why thresholds rose far beyond the shipped ones and what they cost, one sentence each."""
    sentences = [_describe_raised(one) for one in misfit.raised]
    if any(one.is_seen for one in misfit.raised):
        sentences.append(
            "the model does not fit these recordings: identify the robot's own numbers (omnimj identify) or "
            "find what the model lacks (omnimj gap), and calibrate again with --model"
        )
    else:
        sentences.append(
            "no statistic exceeded its shipped threshold: the recordings are too short for this rate, or the "
            "model is slightly wrong; record longer"
        )
    return [*sentences, *_describe_detectable(misfit)]


def _describe_raised(one: RaisedThreshold) -> str:
    words = f"{one.name}: {one.value:.3g} {THRESHOLD_UNITS[one.name]}".removesuffix(" 1")
    words += f", {one.value / one.shipped:.3g} × the shipped {one.shipped:.3g}"
    if one.regime is not None:
        among = f"{one.regime.largest} of the {one.regime.of} largest values lie there"
        share = f"with {100.0 * one.regime.share:.2g} % of the motion"
        words += f"; the statistic is largest while {one.regime.words} ({among}, {share})"
    if one.name == "worn":
        words += f"; a loss that develops slowly is reported from {100.0 * one.value:.2g} % on"
    return words


def _describe_detectable(misfit: ModelMisfit) -> list[str]:
    """Describe the loss of a motor that is still detected, by expectation and by injection."""
    expected = "is expected to be detected" if misfit.motor.loss else "is not expected to be detected,"
    now, before = _detected(misfit.motor), _detected(misfit.shipped_motor)
    sentences = [f"a sudden motor loss {expected} {now}; shipped: {before}"]
    for one in misfit.injected:
        delay = "" if one.delay is None else f", median delay {one.delay:.2g} s"
        sentences.append(
            f"a loss of {100.0 * one.loss:.0f} % injected at {one.tried} places of the recordings is "
            f"diagnosed at {one.found} within {HORIZON:g} s{delay}"
        )
    return sentences


def _detected(loss: DetectableLoss) -> str:
    if loss.loss is None:
        return f"not even one of {100.0 * LOSSES[-1]:.0f} % of the torque"
    share = f"after {100.0 * loss.share:.0f} % of all onsets"
    return f"from {100.0 * loss.loss:.0f} % on ({share}, median delay {loss.delay:.2g} s)"


def calibration_warnings(found: Calibration) -> list[str]:
    """Return the warnings of a calibration, one sentence each."""
    sentences = []
    if found.hours < ADVISED_HOURS:
        sentences.append(
            f"warning: {found.hours:.3g} h of motion are less than {ADVISED_HOURS:g} h; "
            "record longer before relying on these thresholds"
        )
    for name, many in found.remaining:
        diagnoses = "diagnosis" if many == 1 else "diagnoses"
        sentences.append(f"warning: run {name} still has {many} {diagnoses}: is it free of faults?")
    return sentences


def write_thresholds(path: Path, text: str) -> None:
    """Write the file with its folder, in full or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, text)
