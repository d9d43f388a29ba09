"""Made-up runs of a rig with the values of every regime variable, on which a mismatch can be laid."""

import numpy as np

from omnimj.estimate.replay.interface import Channel, Segment

CHANNELS = (
    Channel("carriage_speed", "m/s", "speed of the carriage"),
    Channel("wheel_speed", "rad/s", "speed of the wheel"),
)
NOISE = np.array([0.01, 0.2])
UNITS = {
    "load": "kg",
    "current": "A",
    "speed": "m/s",
    "acceleration": "m/s²",
    "lateral_speed": "m/s",
    "position": "m",
    "wheel_angle": "rad",
    "time": "s",
    "reversal": "s",
    "floor": "",
}
_BLOCKS, _PERIOD = 60, 0.02


def scene(seed=0, lateral=(-0.5, -0.25, 0.0, 0.25, 0.5), floors=("natural_stone",), reversing=False):
    """Pieces, and regimes as name → unit, values: all currents × lateral speeds × loads × floors."""
    random = np.random.default_rng(seed)
    segments, values = [], {name: [] for name in UNITS}
    for current in (0.45, 0.75, 1.05, 1.5):
        for side in lateral:
            for load in (1.9593, 3.9593):
                for floor in floors:
                    columns = _run(random, current, load, reversing)
                    time = columns["time"]
                    first = len(segments) * _BLOCKS
                    name = f"run_{len(segments)}"
                    segments.append(Segment(name, name, first, first + _BLOCKS, time))
                    columns |= {
                        "load": np.full(_BLOCKS, load),
                        "floor": np.full(_BLOCKS, floor, dtype=object),
                    }
                    columns["lateral_speed"] = side + 0.003 * random.normal(size=_BLOCKS)
                    for key, column in columns.items():
                        values[key].append(column)
    return tuple(segments), {name: (UNITS[name], np.concatenate(column)) for name, column in values.items()}


def _run(random, current, load, reversing):
    time = (np.arange(_BLOCKS) + 0.5) * _PERIOD * (2.0 if reversing else 1.0)
    top, lag = 0.4 + 0.7 * current, 0.35 * load / 3.0
    if reversing:
        phase = 2.0 * np.pi * time / 1.1 + random.uniform(0.0, 6.0)
        speed, acceleration = top * np.sin(phase), top * 2.0 * np.pi / 1.1 * np.cos(phase)
        drawn = current * np.sign(acceleration)
    else:
        speed = top * (1.0 - np.exp(-time / lag))
        acceleration, drawn = top / lag * np.exp(-time / lag), current * np.exp(-time) + 0.1
    turned = np.flatnonzero(np.diff(np.sign(speed)) != 0.0) + 1
    since = np.full(_BLOCKS, np.nan)
    for begin in turned:
        since[begin:] = time[begin:] - time[begin]
    place = np.cumsum(speed) * _PERIOD
    return {
        "current": drawn,
        "speed": speed,
        "acceleration": acceleration,
        "position": place,
        "wheel_angle": place / 0.05 + random.uniform(0.0, 6.0),
        "time": time,
        "reversal": since,
    }


def coloured(random, segments, correlation=0.7):
    """Noise of unit size in every segment, correlated from block to block."""
    parts = []
    for segment in segments:
        x = random.normal(size=segment.last - segment.first)
        for k in range(1, len(x)):
            x[k] = correlation * x[k - 1] + np.sqrt(1.0 - correlation**2) * x[k]
        parts.append(x)
    return np.concatenate(parts)


def mismatch(signal, segments, seed=0):
    """A signal in units of noise on the first channel, a fifth of it on the second, noise on both."""
    random = np.random.default_rng(1000 + seed)
    both = [share * signal + coloured(random, segments) for share in (1.0, 0.2)]
    return np.stack(both, axis=1) * NOISE
