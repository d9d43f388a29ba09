"""The blind benchmark: what is drawn, sealed and made."""

from __future__ import annotations

import tomllib
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from benchmark_truths import CASES, LATE, VISCOUS, hiding

from omnimj.effects import RIG, effects_of, with_effects
from omnimj.errors import InputError
from omnimj.estimate.replay.base_parameters import base_parameters
from omnimj.estimate.replay.interface import candidate_effects
from omnimj.parameters import read_floors, read_rig
from omnimj.plant.planar_rig import PlanarRig
from omnimj.recording.read_dataset import read_dataset
from omnimj.simulate.driving import drive_rig
from omnimj.studies.gap_benchmark import datasets
from omnimj.studies.gap_benchmark.cases import (
    FLOORS,
    HiddenEffect,
    case_from_dict,
    draw_cases,
)
from omnimj.studies.gap_benchmark.datasets import DisturbedPlant, make_dataset, true_machine
from omnimj.studies.gap_benchmark.seal import open_seal, seal, seals_labels
from omnimj.studies.gap_benchmark.unmodelled import (
    KINDS,
    STRUCTURES,
    Motion,
    RunContext,
    UnmodelledEffect,
)


def test_every_effect_is_hidden_in_three_sizes_and_the_same_seed_hides_the_same():
    singles = sorted((c.hidden[0].effect, c.hidden[0].size) for c in CASES if c.kind == "single")
    assert singles == sorted(
        (name, size) for name in effects_of(RIG) for size in ("faint", "clear", "obvious")
    )
    assert {c.kind for c in CASES} == {"null", "single", "pair", "triple", "absent", "outside"}
    assert draw_cases(3) == CASES
    assert draw_cases(4) != CASES
    assert [c.kind for c in CASES] != sorted(c.kind for c in CASES)


def test_half_of_the_cases_with_effects_hide_several_and_a_third_of_the_machines_deviate_from_the_equations():
    many = [c for seed in range(6) for c in draw_cases(seed)]
    several = sum(c.kind in ("pair", "triple") for c in many)
    assert several / sum(bool(c.hidden) for c in many) == pytest.approx(0.5, abs=0.02)
    own = [c for c in many if c.kind != "outside"]
    assert sum(c.structure is not None for c in own) / len(own) == pytest.approx(1 / 3, abs=0.05)
    assert {c.structure.kind for c in own if c.structure} == set(STRUCTURES)


@pytest.mark.slow
def test_every_truth_is_a_machine_that_can_be_and_its_constants_lie_inside_their_boxes():
    boxes = {p.name: p for p in base_parameters(read_rig(), read_floors(), FLOORS, ())}
    for case in CASES:
        assert true_machine(case).machine.effects.keys() == {one.effect for one in case.hidden}
        for name, value in case.base.items():
            p = boxes[name]
            assert abs(value - p.nominal) <= 0.4 * (p.high - p.low) + 1e-12


def test_the_search_has_a_candidate_for_everything_that_is_hidden_inside_the_library():
    labels = {form.label for form in candidate_effects(RIG, {})}
    assert {one.label for case in CASES for one in case.hidden} <= labels


def test_a_seal_gives_back_what_was_sealed_and_shows_nothing(tmp_path):
    labels = [case.to_dict() for case in CASES]
    seal(tmp_path, labels)
    assert [case_from_dict(one) for one in open_seal(tmp_path)] == CASES
    assert seals_labels(tmp_path, labels) and not seals_labels(tmp_path, labels[1:])
    assert b"rail" not in (tmp_path / "labels.sealed").read_bytes()
    assert (tmp_path / "labels.key").stat().st_mode & 0o077 == 0
    with pytest.raises(InputError, match="exists"):
        seal(tmp_path, labels)


def test_a_seal_with_another_key_or_a_changed_byte_does_not_open(tmp_path):
    seal(tmp_path, [{"name": "case_000"}])
    content = bytearray((tmp_path / "labels.sealed").read_bytes())
    content[-1] ^= 1
    (tmp_path / "labels.sealed").write_bytes(bytes(content))
    with pytest.raises(InputError, match="broken"):
        open_seal(tmp_path)
    (tmp_path / "labels.key").unlink()
    with pytest.raises(InputError, match=r"labels\.key"):
        open_seal(tmp_path)


@pytest.mark.parametrize("made_by", ["twin", "planar"])
def test_a_disturbance_without_variation_is_the_effect_that_it_degenerates_to(tmp_path, made_by):
    pairs = (
        (
            UnmodelledEffect("drying_rail", 2.0, 1e9, 0.0),
            HiddenEffect("rail_coulomb", {"force": 2.0}, "obvious"),
        ),
        (
            UnmodelledEffect("bent_rail", 0.02, 1e9, 0.5 * np.pi),
            HiddenEffect("grade", {"slope": 0.02}, "clear"),
        ),
    )
    for k, (outside, effect) in enumerate(pairs):
        make_dataset(hiding(outside=outside), tmp_path / f"{k}a", made_by, 0.4, 1)
        make_dataset(hiding(effect), tmp_path / f"{k}b", made_by, 0.4, 1)
        disturbed, plain = (read_dataset(tmp_path / f"{k}{x}").runs[0] for x in "ab")
        for name, values in plain.columns.items():
            # a count more or less is one step of the sensor
            close = np.abs(disturbed.columns[name] - values) < 0.02 * max(np.abs(values).max(), 1.0)
            assert close.mean() > 0.99, (outside.kind, name)


@pytest.mark.slow
def test_every_kind_outside_of_the_library_changes_what_is_measured(tmp_path, monkeypatch):
    straight, sideways = 1, 8  # a run that reverses, and the first one that moves sideways as well
    monkeypatch.setattr(datasets, "_PLAN", (datasets._PLAN[straight], datasets._PLAN[sideways]))
    make_dataset(hiding(), tmp_path / "null", "planar", 0.8)
    plain = read_dataset(tmp_path / "null").runs
    for kind, about in {**KINDS, **STRUCTURES}.items():
        length = 0.5 * (about.shortest + about.longest)
        make_dataset(
            hiding(outside=UnmodelledEffect(kind, about.amplitude, length, 0.0)),
            tmp_path / kind,
            "planar",
            0.8,
        )
        moved = [
            np.abs(run.columns[name][:n] - other.columns[name][:n]).max()
            for run, other in zip(read_dataset(tmp_path / kind).runs, plain, strict=True)
            for name in ("carriage_speed", "carriage_acceleration")
            for n in [min(len(run.time), len(other.time))]
        ]
        assert max(moved) > 0.01, kind


class _Recorder:
    """Keeps what a disturbance is given, and disturbs nothing."""

    def __init__(self):
        self.motions: list[Motion] = []

    def write_terms(self, row, run, motion):
        self.motions.append(motion)


@pytest.mark.parametrize("effects", [{}, {"torque_constant": {"scale": 0.6}}])
def test_a_disturbance_sees_the_current_that_the_motor_draws_where_its_supply_does_not_allow_the_command(
    effects,
):
    rig = with_effects(read_rig(), effects)
    recorder: Any = _Recorder()
    plant = DisturbedPlant(
        PlanarRig(rig, "natural_stone", mass=2.0, seed=1), (recorder,), RunContext(0.0, 2.0), rig
    )
    trace = drive_rig(plant, np.full(3000, 1.4))
    seen = np.array([motion.current for motion in recorder.motions[1:]])
    settled = slice(200, None)
    measured = trace["current"][: len(seen)][settled]
    assert measured[-500:].mean() < 1.0  # far less than commanded
    assert np.abs(seen[settled] - measured).mean() < 0.03


def test_a_dataset_holds_what_a_logger_records_and_nothing_of_the_truth(tmp_path):
    make_dataset(hiding(VISCOUS, LATE), tmp_path / "case_000", "planar", 0.3, 2)
    assert [entry.name for entry in tmp_path.iterdir()] == ["case_000"]
    files = {file.name for file in (tmp_path / "case_000").iterdir()}
    assert files == {"dataset.toml", *(f"run_0{k}{letter}.parquet" for k in (0, 1) for letter in "ab")}
    about = tomllib.loads((tmp_path / "case_000" / "dataset.toml").read_text(encoding="utf-8"))
    assert set(about) == {"plant", "runs"}
    masses = read_rig().rig.masses
    for entry in about["runs"].values():
        assert set(entry) == {"floor", "mass", "repeat_of"} and entry["mass"] in masses
    table = pq.read_schema(tmp_path / "case_000" / "run_00a.parquet")
    logged = ("current", "wheel_speed", "carriage_speed", "carriage_acceleration", "lateral_speed")
    assert table.names == ["time", *logged, "current_target"]
    assert table.metadata is None
