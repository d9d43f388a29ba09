"""Replay of a linear axis' logs for the search for missing effects.

`force`: the equations follow the measured position, and the force needed by that motion is compared with the
measured one; in a closed loop that is where a gap shows. `position`: free windows start from the measured
state and are driven by the measured force alone. `velocity`, where measured: compared with the speed of the
follower.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from omnimj.effects import AXIS
from omnimj.errors import UnknownNameError
from omnimj.estimate.replay.axis import experiments
from omnimj.estimate.replay.axis.kernels import FORCE_COLUMN, POSITION_COLUMN, START, VELOCITY_COLUMN, replay
from omnimj.estimate.replay.axis.log import force_column, force_sign, read_axis_log
from omnimj.estimate.replay.axis.settings import (
    CURVES,
    base_parameters,
    setting_curve,
    setting_row,
    sized_candidates,
    spans_of,
)
from omnimj.estimate.replay.interface import (
    MOST_EFFECTS,
    CandidateEffect,
    Channel,
    Experiment,
    Segment,
    Setting,
    average_blocks,
)
from omnimj.estimate.replay.stretches import block_means
from omnimj.estimate.threads import map_in_threads
from omnimj.parameters.axis import Axis
from omnimj.physics.axis import MASS
from omnimj.physics.native import kernel
from omnimj.recording.dataset import Run
from omnimj.signals import Array

WINDOW = 1.0
"""Length of a free window [s]."""

_ONCE = ("stribeck", "position_friction", "cable_drag")
_CHANNELS = {
    "force": (FORCE_COLUMN, Channel("force", "N", "force that the motion needs")),
    "position": (POSITION_COLUMN, Channel("position", "m", "position after a window without correction")),
    "velocity": (VELOCITY_COLUMN, Channel("velocity", "m/s", "speed of the carriage")),
}
_REVERSED = (
    "{name} has the opposite sign of the motion that it makes and is taken with its sign reversed; "
    'to mend the dataset: [columns] "{name}" = {{ name = "{name}", scale = -1.0 }}'
)
_SETTLING = 5.0  # time constants of the follower at a stretch's start
_SLOWEST, _FASTEST = 2.0 * np.pi, 100.0  # [rad/s] follower
_REST = 3.0  # standard deviations of the smoothed speed below which the axis rests


class AxisReplay:
    """Replay of a dataset of a linear axis; implements `replay.interface.Replay`."""

    plant = AXIS
    most_effects, backward_elimination = MOST_EFFECTS, False

    def __init__(
        self,
        axis: Axis,
        runs: Sequence[Run],
        *,
        window: float = WINDOW,
        channels: Sequence[str] | None = None,
        threads: int | None = None,
    ):
        """Prepare the logs.

        Args:
          axis: The model file's constants and the effects that it has already.
          runs: Measured runs of the axis.
          window: Length of a free window [s].
          channels: Names of the channels to compare; all that were measured when None.
          threads: Threads for several settings at once; the machine's cores when None.

        Raises:
          InputError: A run has neither force nor current, or none is long enough.
          UnknownNameError: A channel does not exist.
        """
        self._axis, self._runs, self._threads = axis, tuple(runs), threads
        self._force_name = force_column(runs[0], axis.axis.force_constant)[0]
        self._log = log = read_axis_log(runs, axis.axis.force_constant, window)
        self.notes: tuple[str, ...] = ()
        """Notes of the data check, one sentence each."""
        if force_sign(log) < 0.0:
            self.notes = (_REVERSED.format(name=self._force_name),)
            self._log = log = dataclasses.replace(log, force=-log.force)
        has_velocity = bool(np.isfinite(log.velocity).any())
        names = tuple(_CHANNELS) if has_velocity else ("force", "position")
        for name in channels or ():
            if name not in names:
                raise UnknownNameError("channels", "channel", name, names)
        chosen = tuple(channels) if channels else names
        self._columns = [_CHANNELS[name][0] for name in chosen]
        self.channels = tuple(_CHANNELS[name][1] for name in chosen)
        wanted = np.sqrt(log.force_noise / (axis.axis.mass * log.position_noise))
        self.rate = float(np.clip(wanted, _SLOWEST, min(_FASTEST, 0.25 / log.period)))
        """Bandwidth ω of the follower [rad/s]: ω² = σ_F/(m σ_x) balances the noise of force and position."""
        self.segments = self._make_pieces()
        self.measured = self._measured()
        self.base = base_parameters(axis, self._force_name, log.period)
        self._spans = spans_of(log)
        self.candidates = self._candidates(has_velocity)
        self.curves: Mapping[str, float] = dict.fromkeys(CURVES, 0.1 * self._spans["force"][1])
        self._by_label = {c.label: c for c in self.candidates}

    def simulate(self, settings: Sequence[Setting]) -> list[Array]:
        """Block means of the channels by the equations, shape (blocks, channels) per setting."""
        return map_in_threads(self._simulate, settings, self._threads)

    def simulate_twin(self, setting: Setting) -> None:
        """Return None: an axis has no roller-level twin, since MuJoCo would solve the same equation."""
        return

    def regimes(self) -> Mapping[str, tuple[str, Array]]:
        """Variable → unit and its measured value in every block, shape (blocks,)."""
        log = self._log
        position, speed, acceleration = log.smooth.T
        resting = np.abs(speed) < _REST * self._speed_noise()
        direction = np.where(resting, 0.0, np.sign(speed))
        since = np.empty(len(speed))
        mass = np.empty(len(speed))
        for s, stretch in enumerate(log.stretches):
            part = slice(int(stretch[0]), int(stretch[1]))
            since[part] = _since_reversal(direction[part]) * log.period
            mass[part] = self._mass_of(s)
        columns = np.stack([position, speed, acceleration, log.times, since, log.force, mass], axis=1)
        means = self._means(columns)
        middle = self._means(direction[:, None])[:, 0]
        found = {
            "speed": ("m/s", means[:, 1]),
            "acceleration": ("m/s2", means[:, 2]),
            "position": ("m", means[:, 0]),
            "direction": ("1", np.rint(middle)),
            "reversal": ("s", means[:, 4]),
            "time": ("s", means[:, 3]),
            "force": ("N", means[:, 5]),
        }
        if len(np.unique(mass)) > 1:
            found["mass"] = ("kg", means[:, 6])
        return found

    def candidate_experiments(self) -> tuple[Experiment, ...]:
        """Runs that a user could make."""
        return experiments.axis_experiments(self._axis)

    def predict(self, settings: Sequence[Setting], experiment: Experiment) -> list[Array]:
        """Predict block means of a candidate run under a servo drive tuned to the declared axis.

        Args:
          settings: Parameter values, one simulation each.
          experiment: One of `candidate_experiments`.

        Returns:
          One array of shape (blocks, channels) per setting.
        """
        return [self._predict(setting, experiment) for setting in settings]

    def row(self, setting: Setting) -> Array:
        """Parameters of the kernels under a setting, with the declared mass, shape (AXIS_ROW,)."""
        return setting_row(self._axis, self.base, self._by_label, setting)

    def _simulate(self, setting: Setting) -> Array:
        log, row = self._log, self.row(setting)
        rows = np.repeat(row[None], len(log.stretches), axis=0)
        for s in range(len(log.stretches)):
            rows[s, MASS] += self._mass_of(s) - self._axis.axis.mass
        found = np.empty((log.blocks, 3))
        free = POSITION_COLUMN in self._columns
        series = (log.times, log.force, log.position, log.smooth)
        curve = setting_curve(setting, self._spans)
        replay(rows, curve, log.stretches, log.windows, *series, self.rate, log.size, free, found)
        found = found[:, self._columns]
        found[np.isnan(self.measured)] = np.nan
        return found

    def _predict(self, setting: Setting, experiment: Experiment) -> Array:
        row = self.row(setting)
        row[MASS] += float(experiment.run["added_mass"])
        columns, period = experiments.drive(self._axis, row, setting_curve(setting, self._spans), experiment)
        return average_blocks(
            columns[:, self._columns], max(1, round(self._log.size * self._log.period / period))
        )

    def _mass_of(self, stretch: int) -> float:
        """Moving mass declared for the run of a stretch [kg]."""
        run = self._runs[self._log.run_of_stretch[stretch]]
        return float(run.conditions.get("mass", self._axis.axis.mass))

    def _means(self, columns: Array) -> Array:
        means = np.empty((self._log.blocks, columns.shape[1]))
        block_means(np.ascontiguousarray(columns), self._log.windows, self._log.size, means)
        return means

    def _measured(self) -> Array:
        log = self._log
        columns = np.stack([log.force, log.position, log.velocity], axis=1)
        columns[log.masked] = np.nan
        columns[log.masked[:, 1], FORCE_COLUMN] = np.nan  # the follower lacks a position there
        settling = max(1, round(_SETTLING / (self.rate * log.period)))
        for stretch in log.stretches:
            first = int(stretch[START])
            columns[first : first + settling, (FORCE_COLUMN, VELOCITY_COLUMN)] = np.nan
        return self._means(columns)[:, self._columns]

    def _make_pieces(self) -> tuple[Segment, ...]:
        log, segments = self._log, []
        means = self._means(log.times[:, None])[:, 0]
        for s, stretch in enumerate(log.stretches):
            run = self._runs[log.run_of_stretch[s]]
            for w in range(int(stretch[2]), int(stretch[2] + stretch[3])):
                first = int(log.windows[w, 2])
                last = first + int(log.windows[w, 1] - log.windows[w, 0]) // log.size
                segments.append(Segment(run.name, run.condition, first, last, means[first:last]))
        return tuple(segments)

    def _candidates(self, has_velocity: bool) -> tuple[CandidateEffect, ...]:
        """Candidate effects that can show in these logs."""
        other = "current" if self._force_name == "force" else "force"
        without = [f"sensor_delay ({other})"]
        if not has_velocity:
            without += ["velocity_scale", "sensor_delay (velocity)"]
        without += [name for name in _ONCE if name in self._axis.effects]
        return sized_candidates(self._axis, self._spans, tuple(without))

    def _speed_noise(self) -> float:
        speed = self._log.smooth[:, 1]
        return max(float(np.median(np.abs(np.diff(speed, 2)))), 1e-4 * float(np.abs(speed).max()), 1e-12)


@kernel
def _since_reversal(direction):
    """Samples since the axis last reversed, or since the start of the stretch, shape (n,)."""
    found, last, count = np.empty(direction.size), 0.0, 0.0
    for k in range(direction.size):
        if direction[k] != 0.0 and direction[k] != last:
            if last != 0.0:
                count = 0.0
            last = direction[k]
        found[k] = count
        count += 1.0
    return found
