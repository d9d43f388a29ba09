"""Replay of the logs of any machine that an MJCF file describes.

- `replay`: `MachineReplay`, the machine with effects as a `Replay` for the search
- `columns`: columns of the dataset as joints, inputs and sensors; what cannot be replayed is refused
- `log`: runs on a common clock, smoothed, cut into stretches, windows and blocks
- `filters`: the filter that motion and inputs share
- `settings`: base parameters, and candidate effects made of the parts of the file
- `laws`: a setting as numbers of the kernels
- `along`: rigid-body forces along the measured motion, by MuJoCo's inverse dynamics
- `delays`: values between rows, and commands as their actuators receive them
- `kernels`: force balance of the joints, and free windows by MuJoCo's steps
"""
