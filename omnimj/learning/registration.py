"""Registration of the environment with Gymnasium.

Importing `omnimj.learning` registers it. Gymnasium 1.0 and later look for no entry points of other packages,
but import the module before a colon: `gymnasium.make("omnimj.learning:omnimj/OmniDrive-v0")`.
"""

from __future__ import annotations

from omnimj.errors import MissingLibrary

ENVIRONMENT = "omnimj/OmniDrive-v0"
"""Name of the environment in Gymnasium."""


def register_environments() -> None:
    """Register the environment unless it is registered already.

    Raises:
      MissingLibrary: Gymnasium is not installed.
    """
    try:
        from gymnasium.envs.registration import register, registry
    except ModuleNotFoundError as error:
        if not str(error.name).startswith("gymnasium"):
            raise
        raise MissingLibrary("omnimj.learning", "Gymnasium", "gym") from None
    if ENVIRONMENT not in registry:
        register(
            id=ENVIRONMENT,
            entry_point="omnimj.learning.environment:OmniDrive",
            vector_entry_point="omnimj.learning.vector:OmniDriveVector",
        )
