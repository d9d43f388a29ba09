"""Rig runs prepared for the fit of a floor."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter

from omnimj.estimate.rig_runs import ACCELERATION, AT_REST, CARRIAGE, WHEEL, RigRun
from omnimj.parameters import Rig
from omnimj.parameters.floor import LUGRE, TractionParameters
from omnimj.parameters.parts import GRAVITY
from omnimj.physics import carriage
from omnimj.physics.rig import lateral_force, rail_friction, rig_parameters
from omnimj.signals import Array, true_stretches

BLOCK = 0.01
"""Length of a block [s]: a roller passes in about this time at top speed."""
_DEAD_BANDS = 2.0  # × the encoder's dead band that the carriage must travel before its speed counts
_WINDOW = 0.05  # [s] over which slip is compared with its own ripple
_CLEAR = 2.0  # × its ripple that slip must be
_LOST = 0.02  # [s] without wheel speed, after which a run is uncertain …
_FINDS_BACK = 0.2  # … for this long [s], several times the bristle's and the carriage's time constants


@dataclass(frozen=True)
class CarriageRun:
    """Run prepared for `physics.carriage.simulate_carriage`."""

    run: RigRun
    parameters: carriage.CarriageParameters
    """Mass, wheel radius and resistances of the run."""
    wheel_speed: Array
    """Wheel speed, cut to whole blocks, shape (k,) [rad/s]."""
    use: Array
    """Samples that count for speed and acceleration, shape (k, 2)."""
    per_block: int
    decay: float
    """Decay of the accelerometer's low-pass filter over one sample."""
    measured: Array
    """Block means of speed and acceleration, NaN where nothing counts, shape (m, 2)."""

    @property
    def blocks(self) -> int:
        """Number of block means that count."""
        return int(np.isfinite(self.measured).sum())

    @property
    def time(self) -> Array:
        """Block centres, shape (m,) [s]."""
        width = self.per_block * self.run.period
        return width * (np.arange(len(self.measured), dtype=np.float64) + 0.5)

    def pull(self, floor: TractionParameters, radius_scale: float) -> Array:
        """Block means of speed, acceleration, slip, F/F_N for a floor, shape (m, carriage.BLOCK)."""
        own = self.parameters._replace(radius=self.parameters.radius * radius_scale)
        blocks = np.empty((len(self.measured), carriage.BLOCK))
        h, per_block = self.run.period, self.per_block
        carriage.simulate_carriage(own, floor, self.wheel_speed, h, self.decay, per_block, self.use, blocks)
        return blocks

    def with_known(
        self, rail_friction_added: float = 0.0, mass_added: float = 0.0, wheel_late: float = 0.0
    ) -> CarriageRun:
        """The run with added rail friction [N], mass [kg], and delay of the wheel speed [s]."""
        own = self.parameters
        changed = own._replace(
            dry=own.dry + rail_friction_added, mass=own.mass + mass_added, delay=own.delay + wheel_late
        )
        return replace(self, parameters=changed)


def lugre(numbers: Array) -> TractionParameters:
    """LuGre law for the kernels of μ_c, μ_s, V_s, σ0, σ1, σ2, shape (6,)."""
    return TractionParameters(float(LUGRE), *numbers)


def resistance(rig: Rig, mass: float, lateral_speed: float) -> tuple[float, float]:
    """Compute the dry [N] and the viscous resistance [N.s/m] of the carriage, Eqs. 4.12-4.18.

    The measured friction of the rail, the rolling resistance and, while the gantry moves at some speed [m/s],
    the load that the friction of the rollers adds to the rail; the mass is m_T of the quarter body [kg].
    """
    found = rig_parameters(rig, mass)
    dry, viscous = rail_friction(found, lateral_force(found, lateral_speed))
    return dry + rig.wheel.rolling_resistance * mass * GRAVITY, viscous


def carriage_run(rig: Rig, run: RigRun) -> CarriageRun:
    """Prepare a run: cut it into blocks and exclude samples that the sensors cannot resolve."""
    h = run.period
    per_block = max(1, round(BLOCK / h))
    count = len(run.time) // per_block * per_block
    dry, viscous = resistance(rig, run.mass, run.lateral_speed)
    start, _ = run.start_speeds
    use = _usable(rig, run)[:count].astype(float)
    # both filters apply to both: that of the speeds, and that of the accelerometer
    lag = math.exp(-h / rig.sensors.speed_filter)
    felt = run.values[:, ACCELERATION]
    acceleration = lfilter([1.0 - lag], [1.0, -lag], felt, zi=[lag * felt[0]])[0]
    values = np.stack((run.values[:, CARRIAGE], np.asarray(acceleration)), axis=1)[:count]
    measured = _block_means(values, use, per_block)
    decay = math.exp(-2.0 * math.pi * rig.sensors.accelerometer_bandwidth * h)
    radius, lateral = rig.wheel.radius, float(run.lateral_speed)
    own = carriage.CarriageParameters(float(run.mass), radius, dry, viscous, start, 0.0, lateral)
    wheel_speed = np.ascontiguousarray(run.values[:count, WHEEL])
    return CarriageRun(run, own, wheel_speed, use, per_block, decay, measured)


def _usable(rig: Rig, run: RigRun) -> NDArray[np.bool_]:
    """Mask of samples of speed and acceleration that count, shape (k, 2)."""
    h = run.period
    use = run.measured[:, [CARRIAGE, ACCELERATION]]
    use &= (_has_travelled(rig, run) & _slips_clearly(rig, run))[:, None]
    finds_back = round(_FINDS_BACK / h)
    if not run.starts_at_rest:  # the deflection of the bristle is unknown
        use[:finds_back] = False
    for first, last in true_stretches(~run.measured[:, WHEEL]):
        if last - first >= max(2, round(_LOST / h)):
            use[first : last + finds_back] = False
    return use


def _slips_clearly(rig: Rig, run: RigRun) -> NDArray[np.bool_]:
    """Mask of samples whose slip is well above its own ripple and noise in a short window.

    The bristle relaxes with |V_r|: ripple of rollers and encoders on a small slip does not average out in
    it, and the speed filter hides part of it.
    """
    slip = rig.wheel.radius * run.values[:, WHEEL] - run.values[:, CARRIAGE]
    window = max(3, round(_WINDOW / run.period))
    mean = uniform_filter1d(slip, window, mode="nearest")
    ripple = np.sqrt(uniform_filter1d(np.square(slip - mean), window, mode="nearest").clip(0.0))
    return np.abs(mean) > _CLEAR * ripple


def _has_travelled(rig: Rig, run: RigRun) -> NDArray[np.bool_]:
    """Mask of samples beyond the dead band of the carriage's encoder since the last stop or reversal."""
    s = rig.sensors
    least = _DEAD_BANDS * s.encoder_hysteresis * s.carriage_encoder_radius
    speed = run.values[:, CARRIAGE]
    moving = np.where(np.abs(speed) > AT_REST, np.sign(speed), 0.0)
    way = np.cumsum(np.abs(speed)) * run.period
    begins = np.concatenate(([True], moving[1:] != moving[:-1])) | (moving == 0.0)
    since = np.maximum.accumulate(np.where(begins, way, 0.0))
    return way - since >= least


def _block_means(values: Array, use: Array, per_block: int) -> Array:
    """Average the samples that count over blocks; NaN where fewer than half do."""
    shape = (-1, per_block, values.shape[1])
    counted = use.reshape(shape).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        means = (values * use).reshape(shape).sum(axis=1) / counted
    return np.where(counted >= 0.5 * per_block, means, np.nan)
