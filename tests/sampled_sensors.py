"""One sample of the sensors of a robot or a rig, of given quantities."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from omnimj.plant.sensor_chain import read_sensors
from omnimj.plant.sensors import RigSensors, RobotSensors


def sample(sensors: RobotSensors | RigSensors, time: float, *quantities: ArrayLike) -> Any:
    """Measurement of the true quantities in the order of the channels, numbers or arrays of several."""
    sensors.values[:] = np.concatenate([np.ravel(quantity) for quantity in quantities])
    sensors.refill()
    # an integer time would make the kernel compile again
    return sensors.as_measurement(time, read_sensors(sensors.chain, float(time), sensors.values))
