"""Catalogue of suites; a new one, for any plant, is one entry here."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from omnimj.errors import UnknownNameError
from omnimj.parameters import read_rig, read_robot
from omnimj.plant.mujoco.machine import read_machine_file
from omnimj.recording.dataset import MJCF
from omnimj.simulate.machine.linear_axis import read_axis
from omnimj.simulate.suites import machine, missions, rig
from omnimj.simulate.suites.suite import Suite

_RIG = ("quarter_rig", read_rig)
_SUITES = (
    Suite(
        "rig_currents",
        "identification: 0.15 … 1.5 A on three floors, full mass",
        *_RIG,
        rig.plan_currents,
        rig.record_rig,
        repeats=2,
    ),
    Suite(
        "rig_validation",
        "validation: 0.45 … 1.5 A on three floors with three masses",
        *_RIG,
        rig.plan_validation,
        rig.record_rig,
        repeats=2,
    ),
    Suite(
        "rig_lateral",
        "sideways motion: four currents at eight lateral speeds on natural stone",
        *_RIG,
        rig.plan_lateral,
        rig.record_rig,
        repeats=2,
    ),
    Suite(
        "rig_mixed",
        "for the gap: reversals, coasting, braking, slow and fast, straight and sideways",
        *_RIG,
        rig.plan_mixed,
        rig.record_rig,
    ),
    Suite(
        "robot_missions",
        "six random missions of 20 s with the controller, on three floors",
        "uto_robot",
        read_robot,
        missions.plan_missions,
        missions.record_robot,
    ),
    Suite(
        "axis_moves",
        "the linear axis: fast, slow, short and crawling motions under position control",
        "linear_axis",
        read_axis,
        machine.plan_axis_motions,
        machine.record_axis,
        repeats=2,
        plants=("twin", "planar"),  # both names mean the same plant, which moves along a line
    ),
    Suite(
        "machine_moves",
        "any machine with an MJCF file (--model): fast, slow, short and crawling motions of its joints",
        MJCF,
        read_machine_file,
        machine.plan_motions,
        machine.record_machine,
        repeats=2,
        plants=("twin",),
    ),
)
SUITES: Mapping[str, Suite] = MappingProxyType({suite.name: suite for suite in _SUITES})
"""Suites by name."""


def find_suite(name: str) -> Suite:
    """Find a suite by name.

    Raises:
      UnknownNameError: No such suite; the message lists the choices.
    """
    if name not in SUITES:
        raise UnknownNameError("omnimj record", "suite", name, SUITES)
    return SUITES[name]
