"""Registration of the environment with Gymnasium.

Gymnasium calls `register_environments` when it is imported, by the entry point in `pyproject.toml`; importing
`omnimj.learning` does the same for a checkout that is not installed.
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
        if error.name != "gymnasium":
            raise
        raise ImportError(_MISSING, name="gymnasium") from None
    if ENVIRONMENT not in registry:
        register(
            id=ENVIRONMENT,
            entry_point="omnimj.learning.environment:OmniDrive",
            vector_entry_point="omnimj.learning.vector:OmniDriveVector",
        )
