"""What the robust method's observer weighs its sensors with."""

from __future__ import annotations

from dataclasses import dataclass

from omnimj.parameters.reading import positive


@dataclass(frozen=True)
class ObserverGains:
    """Gains of the observer: noises of its filters, as standard deviations, and how long it remembers.

    When a suspicion becomes a decision is another matter: `verdict.Thresholds` are calibrated against false
    alarms, not tuned.
    """

    wheel_noise: float = positive("m/s", 1.0, default=0.004)
    """Of a rolling wheel's word about the body's velocity."""
    creep_noise: float = positive("1", 10.0, default=0.35)
    """The same per m/s of its creep."""
    acceleration_noise: float = positive("m/s2", 10.0, default=0.04)
    """Of a block's mean of the accelerometer: noise, and gravity while the body pitches on its springs."""
    memory: float = positive("s", 1e5, default=120.0)
    """Time in which a number that was learnt of the healthy robot may wander by its own prior."""
