"""Speed benchmark of `omnimj bench`: ratios and times measured within one run on this machine.

- `control`: time and memory of the control step, on a recorded mission replayed without the plant.
- `twin`: steps of the twin against MuJoCo's own contact, batches, and whole scenario runs.
- `link`: the codec of the link, and round trips over UDP and a pseudo-terminal.
- `link_echo`: the far end of these round trips, in a process of its own.
"""
