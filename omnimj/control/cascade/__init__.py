"""Cascade control: heading → inverse kinematics → wheel-speed PI → limits.

- `controller`: `Controller` and the compiled step of the whole cascade
- `heading`: heading estimate, yaw-rate demand, standstill and the gyro's bias
- `allocation`: wheel speeds from a twist, and the published forward map
- `wheel_speed`: PI law of one wheel with anti-windup
- `limits`: last gate on the currents
"""
