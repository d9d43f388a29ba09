"""Floors as text, in the format of `models/floors.toml`."""

from __future__ import annotations

import json
from collections.abc import Iterable

from omnimj.parameters.floor import Floor

_DIGITS = 6
UNITS = "# mu_c, mu_s, mu_cap 1; V_s m/s; sigma_0 1/m; sigma_1, sigma_2 s/m."


def one_line(words: str) -> str:
    """What can stand in a comment or a text: a line break would end it, control signs are not TOML."""
    return "".join(sign if sign.isprintable() else "?" for sign in words)


def floor_text(floor: Floor, remarks: Iterable[str] = ()) -> str:
    """One entry, which `read_floors` reads.

    Args:
      floor: Its numbers are written with six digits.
      remarks: Comments above the numbers, a line each.
    """
    lines = [f"[{floor.name}]", f"description = {_quoted(floor.description)}", f'law = "{floor.law}"']
    lines += [f"source = {_quoted(floor.source)}", f"uncertainty = {floor.uncertainty:.3g}"]
    lines += [f"# {one_line(remark)}" for remark in remarks]
    lines += [f"{name} = {value:.{_DIGITS}g}" for name, value in floor.numbers.items()]
    return "\n".join(lines) + "\n"


def _quoted(words: str) -> str:
    return json.dumps(one_line(words), ensure_ascii=False)
