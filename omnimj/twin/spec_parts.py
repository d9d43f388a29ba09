"""Reads MJCF and finds its parts by name; whatever is wrong there is one line for the user."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco

from omnimj.errors import InputError

_NOT_READ = "is not a model that MuJoCo reads"


def _one_line(error: ValueError) -> str:
    return " ".join(str(error).split())


def load_spec(path: Path, instead: Mapping[str, bytes] | None = None) -> mujoco.MjSpec:
    """Parses an MJCF file.

    Args:
      path: The file.
      instead: Contents that stand in for files which it includes, by their names.

    Raises:
      InputError: MuJoCo cannot read it; the message is MuJoCo's own.
    """
    try:
        return mujoco.MjSpec.from_file(
            str(path.resolve()), include=instead
        )  # includes of a relative path go astray
    except ValueError as error:
        raise InputError(path, _NOT_READ, _one_line(error)) from None


def compile_spec(spec: mujoco.MjSpec, path: Path) -> mujoco.MjModel:
    """Compiles a parsed model.

    Raises:
      InputError: MuJoCo cannot compile it; the message is MuJoCo's own.
    """
    try:
        return spec.compile()
    except ValueError as error:
        raise InputError(path, _NOT_READ, _one_line(error)) from None


def part(spec: mujoco.MjSpec, kind: str, name: str) -> Any:
    """A body, joint, geom, site, mesh or actuator by name.

    Raises:
      InputError: The MJCF has no such part.
    """
    found = getattr(spec, kind)(name)
    if found is None:
        raise InputError(f"MJCF model '{spec.modelname}'", f"has no {kind} '{name}'")
    return found
