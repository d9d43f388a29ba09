"""A setting as numbers of the kernels: laws of the joints, inputs, masses, readings of the channels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.effects import ChannelEffect, find_effect
from omnimj.effects.mjcf import NO_LIMIT
from omnimj.effects.parts import ACTUATOR, BODY, JOINT, Part, PartChanges, Payload
from omnimj.estimate.replay.interface import BaseParameter, CandidateEffect, Setting
from omnimj.estimate.replay.mjcf.columns import MeasuredParts
from omnimj.estimate.replay.mjcf.kernels import (
    ARMATURE,
    ASYMMETRIC_DAMPING,
    ASYMMETRIC_DRY,
    BIAS,
    BRAKING,
    CABLE,
    CABLE_REST,
    COMPLIANCE,
    DAMPING,
    DECLARED_HIGH,
    DECLARED_LOW,
    DRY,
    FADING,
    FORCE_PER_UNIT,
    GAIN,
    GEAR,
    HIGH,
    LAW,
    LOAD_SHARE,
    LOW,
    OFFSET,
    PLACE,
    PLACE_FORCE,
    PLACE_WIDTH,
    PLAY,
    POSITION_GAIN,
    QUADRATIC,
    REST_SPEED,
    SPRING,
    SPRING_REST,
    STILL,
    STRIBECK_FORCE,
    STRIBECK_VELOCITY,
    VELOCITY_GAIN,
)
from omnimj.plant.mujoco.machine import Machine, Uncertain, apply_part_effects
from omnimj.plant.mujoco.quantities import changed_drive, changed_values, tilted_gravity
from omnimj.signals import Array

TIMING = "timing"
"""Base parameter: lag of the positions' clock behind that of the inputs, less than a sample period [s]."""

_STILL = 0.5  # share of the rest speed up to which a joint with a measured force may have any friction
_QUANTITIES = {
    DAMPING: "damping",
    QUADRATIC: "quadratic_damping",
    DRY: "frictionloss",
    ARMATURE: "armature",
    SPRING: "stiffness",
    SPRING_REST: "springref",
}
_TERMS = {
    CABLE: "spring",
    CABLE_REST: "spring_rest",
    ASYMMETRIC_DRY: "asymmetric_coulomb",
    ASYMMETRIC_DAMPING: "asymmetric_viscous",
    STRIBECK_FORCE: "stribeck_force",
    STRIBECK_VELOCITY: "stribeck_velocity",
    PLACE_FORCE: "place_force",
    PLACE: "place_position",
    PLACE_WIDTH: "place_width",
    LOAD_SHARE: "load_share",
    OFFSET: "offset",
    COMPLIANCE: "compliance",
    PLAY: "play",
}


@dataclass(frozen=True)
class InputLaw:
    """Change of the measured input of a joint before it acts."""

    reading: ChannelEffect
    """Form in which the log shows it."""
    delay: float
    """By which the actuator answers late [s]."""
    lag: float
    limits: tuple[float, float]
    """Least and largest command."""


@dataclass(frozen=True)
class Laws:
    """Machine under a setting, as the kernels take it."""

    joints: Array
    """Laws of the joints, shape (j, LAW)."""
    inputs: tuple[InputLaw | None, ...]
    masses: Mapping[Part, float]
    payloads: tuple[Payload, ...]
    gravity: Array
    channels: Mapping[str, ChannelEffect]
    clock: float
    """Lag of the positions' clock behind that of the inputs [s]."""

    def has_force(self, joint: int) -> bool:
        """True for a joint whose actuator's force was measured."""
        return bool(self.joints[joint, STILL] > 0.0)

    def channel(self, name: str) -> ChannelEffect:
        """Change of the readings of a channel."""
        return self.channels.get(name, ChannelEffect())


@dataclass(frozen=True)
class LawMaker:
    """Maker of the laws of a machine for every setting."""

    machine: Machine
    parts: MeasuredParts
    uncertain: tuple[Uncertain, ...]
    candidates: Mapping[str, CandidateEffect]
    rest_speed: Array
    """Speed up to which a joint counts as at rest, shape (j,)."""

    def make(self, base: Sequence[BaseParameter], setting: Setting) -> Laws:
        """Laws under a setting.

        Args:
          base: Base parameters: those of `uncertain`, then `TIMING`.
        """
        values = dict(zip([b.name for b in base], np.asarray(setting.base, float).tolist(), strict=True))
        own = {one.part: values[one.name] - one.beyond for one in self.uncertain}
        changes = self.changes(setting)
        clock = 0.0 if self._has_late_position(changes) else values[TIMING]
        return self._laws(changed_values(self.machine.values, own, changes), changes, clock)

    def _has_late_position(self, changes: PartChanges) -> bool:
        """True if a delay of the only joint's position stands for the offset of the clocks.

        The two are one quantity where nothing else was measured. One against the other they would leave the
        times as they are and interpolate both signals, which takes away noise.
        """
        if len(self.parts.joints) != 1 or any(self.parts.has_velocity) or self.parts.sensors:
            return False
        return changes.channels.get(f"position:{self.parts.joints[0]}", ChannelEffect()).delay != 0.0

    def changes(self, setting: Setting) -> PartChanges:
        """Changes by the effects of the machine's file and by those of a setting."""
        changes = apply_part_effects(self.machine)
        for label, numbers in setting.effects.items():
            candidate = self.candidates[label]
            for hook in find_effect(candidate.effect, self.machine.plant, label).hooks:
                hook(changes, {**candidate.selectors, **candidate.values(numbers)})
        return changes

    def _laws(self, values: Mapping[Part, float], changes: PartChanges, clock: float) -> Laws:
        rows, inputs = np.zeros((len(self.parts.joints), LAW)), []
        for j, name in enumerate(self.parts.joints):
            row = rows[j]
            for place, key in _QUANTITIES.items():
                row[place] = values[JOINT, name, key]
            for place, key in _TERMS.items():
                row[place] = changes.terms.get((JOINT, name, key), 0.0)
            row[STRIBECK_VELOCITY] = row[STRIBECK_VELOCITY] or 1.0
            row[PLACE_WIDTH] = row[PLACE_WIDTH] or 1.0
            row[REST_SPEED], row[GEAR] = self.rest_speed[j], 1.0
            row[LOW], row[HIGH] = row[DECLARED_LOW], row[DECLARED_HIGH] = -np.inf, np.inf
            row[FORCE_PER_UNIT] = 1.0
            inputs.append(self._input(j, row, values, changes))
        return Laws(
            rows,
            tuple(inputs),
            {part: value for part, value in values.items() if part[0] == BODY},
            tuple(p for p in changes.payloads if p.mass != 0.0),
            tilted_gravity(self.machine.mj_model.opt.gravity, changes.tilt),
            changes.channels,
            clock,
        )

    def _input(
        self, j: int, row: Array, values: Mapping[Part, float], changes: PartChanges
    ) -> InputLaw | None:
        own = self.parts.inputs[j]
        if own is None:
            return None
        reading = changes.channels.get(own.column, ChannelEffect())
        limit = changes.limits.get(own.drive.name, NO_LIMIT)
        drive = changed_drive(own.drive, values, np.inf if limit >= NO_LIMIT else limit)
        row[GEAR] = drive.gear
        if own.is_force:
            row[GAIN], row[STILL] = 1.0, _STILL
            if self.machine.forces_are_declared:
                row[GAIN] = drive.gain / own.drive.gain
            law = InputLaw(reading, 0.0, 0.0, (-np.inf, np.inf))
        else:
            row[GAIN], row[BIAS] = drive.gain, drive.bias
            row[POSITION_GAIN], row[VELOCITY_GAIN] = drive.position_gain, drive.velocity_gain
            row[LOW], row[HIGH] = drive.force_range
            row[DECLARED_LOW], row[DECLARED_HIGH] = own.drive.force_range
            row[FADING] = changes.terms.get((ACTUATOR, drive.name, "fading"), 0.0)
            row[BRAKING] = changes.terms.get((ACTUATOR, drive.name, "braking"), 0.0)
            delay = changes.terms.get((ACTUATOR, drive.name, "delay"), 0.0)
            law = InputLaw(reading, delay, drive.lag, drive.command_range)
        row[FORCE_PER_UNIT] = row[GEAR] * row[GAIN] / reading.scale
        return law
