"""omnimj: a MuJoCo twin of a four-wheel omni robot and of its one-wheel test rig."""

__version__ = "0.1.0"
