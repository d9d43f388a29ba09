"""The robot as a Gymnasium environment, `omnimj/OmniDrive-v0`, alone or many side by side in threads.

A policy drives along planned motions and adds to what the cascade commands, or sets the currents itself. It
sees measurements and targets, as a controller does; the truth about pose and faults is in `info` only.

    import gymnasium
    import omnimj.learning                      # registers it; "omnimj.learning:omnimj/…" does so by itself

    environment = gymnasium.make("omnimj/OmniDrive-v0", plant="planar", floor="pvc")
    many = gymnasium.make_vec("omnimj/OmniDrive-v0", num_envs=16, plant="planar")

- `options`: the options of an environment, and its random motions
- `observation`: what the policy sees
- `simulation`: one robot under a policy, common to both kinds of environment; `period` and
  `twin` are its kernels
- `environment`, `vector`: the two kinds; `picture` draws them
- `registration`: their names in Gymnasium
"""

from omnimj.learning.registration import ENVIRONMENT, register_environments

__all__ = ["ENVIRONMENT", "register_environments"]

register_environments()
