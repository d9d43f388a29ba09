"""Speed benchmark of `omnimj bench`: times, and ratios of times, measured in one session on one machine.

- `control`: time and memory of the control step, on a recorded mission replayed without the plant, and the
 diagnosis of recorded runs.
- `twin`: steps of the twin compared with MuJoCo's own contact, batches, and whole scenario runs.
- `gap`: the search for missing effects, compared with the simulations that it makes.
- `link`: the codec of the link, and round trips over UDP and a pseudo-terminal.
- `link_echo`: the far end of these round trips, in a separate process.
"""
