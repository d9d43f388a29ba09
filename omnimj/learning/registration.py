"""Registration of the environment with Gymnasium.

Importing `omnimj.learning` registers it. Gymnasium 1.0 and later look for no entry points of other packages,
but import the module before a colon: `gymnasium.make("omnimj.learning:omnimj/OmniDrive-v0")`.
"""

from __future__ import annotations

ENVIRONMENT = "omnimj/OmniDrive-v0"
"""Name of the environment in Gymnasium."""
_MISSING = "omnimj.learning needs Gymnasium: pip install 'omnimj[gym]'"


def register_environments() -> None:
    """Register the environment unless it is registered already.

    Raises:
      ImportError: Gymnasium is not installed; the message says how to install it.
    """
    try:
        from gymnasium.envs.registration import register, registry
    except ModuleNotFoundError as error:
        if not str(error.name).startswith("gymnasium"):
            raise
        raise ImportError(_MISSING, name="gymnasium") from None
    if ENVIRONMENT not in registry:
        register(
            id=ENVIRONMENT,
            entry_point="omnimj.learning.environment:OmniDrive",
            vector_entry_point="omnimj.learning.vector:OmniDriveVector",
        )
