"""Identification of a robot from logs of healthy driving.

- `blocks`: the logs filtered alike, at one instant, every 10 ms
- `unknowns`: what is estimated, its prior from the model file, and the constants of the balance that follow
- `balance`: accelerations that the motors' torques predict
- `fit`: the maximum a posteriori estimate
- `uncertainty`: intervals by leaving out whole runs
- `excitation`: what the drive did not excite, and the manoeuvre that would
- `creep`: slip of the wheels against their traction, and the law that fits held-out runs best
- `records`, `files`: results as records and as files
- `identify`: all of it for one dataset
"""
