"""Indices of the native contact's parameters in the `user` arrays of the compiled model.

A floor is a geom with its traction law in `geom_user`; the geom of a roller holds the index of its wheel; a
wheel is an actuator whose `actuator_user` holds all constants of that wheel and its motor. Models in one
process may therefore differ, and copies, batches and saved models contain their parameters.
"""

from __future__ import annotations

from omnimj.parameters.floor import TRACTION_SIZE
from omnimj.physics.effect_terms import TERMS
from omnimj.physics.motor import MOTOR_SIZE

# geom_user
KIND = 0
NOT_OURS, FLOOR, PATCH, ROLLER = 0.0, 1.0, 2.0, 3.0
TRACTION = 1  # … 1 + TRACTION_SIZE: the packed traction law (floors and patches)
FIRST_PATCH = TRACTION + TRACTION_SIZE  # floors: id of the first patch geom that lies on them
PATCH_COUNT = FIRST_PATCH + 1
ROLLER_WHEEL = 1  # rollers: index of the wheel (its actuator)
GEOM_SLOTS = PATCH_COUNT + 1

# actuator_user
MAGIC = 0
MAGIC_NUMBER = 20.25e6  # mark in slot 0 of actuator 0: the native contact handles this model
WHEELS = 1  # number of wheels
WHEEL_BODY, WHEEL_DOF, FIRST_ROLLER_DOF, ROLLER_COUNT = 2, 3, 4, 5
SENSOR = 6  # address of this wheel's block in sensordata
RAIL_JOINT = 7  # joint that carries the rig's rail friction, -1: none
FLOOR_OVERRIDE = 8  # geom whose floor applies under this wheel at every position, -1: none
GRIP = 9  # factor on the traction of this wheel
RADIUS = 10
STIFFNESS, DAMPING = 11, 12
ROLLER_DRY, ROLLER_VISCOUS, ROLLER_SIGMA_0, ROLLER_SIGMA_1, ROLLER_GRIP, ROLLER_COAST = 13, 14, 15, 16, 17, 18
ROLLING_RESISTANCE = 19
BEARING_DRY, BEARING_VISCOUS, BEARING_RADIUS, BEARING_SPACING, BEARING_OVERHANG = 20, 21, 22, 23, 24
MOTOR = 25  # … 25 + MOTOR_SIZE: the packed motor
EFFECT_TERMS = MOTOR + MOTOR_SIZE  # … + TERMS: the packed effect terms of this wheel
ANGLE_ADDRESS = EFFECT_TERMS + TERMS  # of the wheel's angle in qpos
POSITION_ADDRESS = ANGLE_ADDRESS + 1  # of the rig's carriage in qpos
ROLLER_SIN, ROLLER_COS = (
    POSITION_ADDRESS + 1,
    POSITION_ADDRESS + 2,
)  # of the angle from the axle to a roller's axis
ACTUATOR_SLOTS = ROLLER_COS + 1

# jnt_user of the rig's rail
RAIL_COULOMB, RAIL_DRY, RAIL_VISCOUS, RAIL_HALF_WIDTH, RAIL_HEIGHT, RAIL_D, RAIL_E, RAIL_WEIGHT = range(8)
RAIL_LOAD_TIME = 8
JOINT_SLOTS = 9

# activations of a wheel's actuator
CURRENT, BRISTLE, LATERAL_BRISTLE = 0, 1, 2
BACKLASH, BACKLASH_RATE = 3, 4  # angle of the rotor relative to the wheel, after the gear, and its rate
ACTIVATIONS = 5
LATERAL_LOAD = 5  # rig only: low-passed lateral force of the floor on rail and bearings

# a wheel's block in sensordata
SENSOR_FIELDS = (
    "slip_velocity",
    "normal_force",
    "traction_force",
    "lateral_force",
    "lateral_velocity",
    "next_bristle",
    "next_lateral_bristle",
    "rolling_resistance",
)
