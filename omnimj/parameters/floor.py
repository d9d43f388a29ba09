"""Floors: a name, a traction law and its parameters, read from and written as entries of `floors.toml`."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.reading import Rule, check_choice, check_number, read_toml, require_keys
from omnimj.resources import models_folder

LUGRE, MAGIC_FORMULA, CREEP_RATIO = 0, 1, 2
"""Steady traction laws, as packed for the kernels."""

_POSITIVE = Rule(0.0, float("inf"), True)
_NOT_NEGATIVE = Rule(0.0, float("inf"), False)
_SHARE = Rule(0.0, 1.0, False)
_ANY = Rule(-float("inf"), float("inf"), False)
LAWS: Mapping[str, tuple[int, Mapping[str, Rule]]] = MappingProxyType(
    {
        "lugre": (
            LUGRE,
            {
                "mu_c": _POSITIVE,
                "mu_s": _POSITIVE,
                "V_s": _POSITIVE,
                "sigma_0": _POSITIVE,
                "sigma_1": _NOT_NEGATIVE,
                "sigma_2": _NOT_NEGATIVE,
            },
        ),
        "magic_formula": (
            MAGIC_FORMULA,
            {
                "B": _POSITIVE,
                "C": _POSITIVE,
                "D": _POSITIVE,
                "E": _ANY,
                "relaxation_length": _POSITIVE,
                "damping_time": _NOT_NEGATIVE,
            },
        ),
        "creep_ratio": (
            CREEP_RATIO,
            {
                "mu": _POSITIVE,
                "creep_stiffness": _POSITIVE,
                "relaxation_length": _POSITIVE,
                "damping_time": _NOT_NEGATIVE,
            },
        ),
    }
)
"""Traction law by name: its index for the kernels, and the rules of the parameters that it needs."""
OPTIONAL: Mapping[str, Rule] = MappingProxyType(
    {
        "mu_cap": _POSITIVE,
        "load_exponent": Rule(0.0, 2.0, True),
        "reference_load": _POSITIVE,
        "rolling_resistance": _NOT_NEGATIVE,
        "roller_resistance": _NOT_NEGATIVE,
        "roller_dry": _NOT_NEGATIVE,
    }
)
"""Rules of the parameters that a floor of any law may have."""
OPTIONAL_OF_LAW: Mapping[str, Mapping[str, Rule]] = MappingProxyType({"lugre": {"turnover": _NOT_NEGATIVE}})
"""Rules of further parameters that a floor of one law may have, by law."""

_DIGITS = 6
FLOOR_UNITS = (
    "# mu, mu_c, mu_s, mu_cap 1; V_s m/s; sigma_0 1/m; sigma_1, sigma_2 s/m; B, C, D, E, creep_stiffness 1;\n"
    "# turnover 1/m; relaxation_length m; damping_time s; load_exponent 1; reference_load N;\n"
    "# rolling_resistance, roller_resistance, roller_dry 1."
)
"""Comment with the units of the parameters of a floor."""


class TractionParameters(NamedTuple):
    """Traction law as packed for the kernels; the parameters of the other laws are zero."""

    law: float
    """`LUGRE`, `MAGIC_FORMULA` or `CREEP_RATIO`."""
    mu_c: float = 0.0
    mu_s: float = 0.0
    V_s: float = 0.0
    """Stribeck velocity [m/s]."""
    sigma_0: float = 0.0
    """Bristle stiffness over normal force [1/m]."""
    sigma_1: float = 0.0
    """Bristle damping over normal force [s/m]."""
    sigma_2: float = 0.0
    """Viscous coefficient over normal force [s/m]."""
    mu_cap: float = np.inf
    """Ceiling of F/F_N at the reference load; infinite if there is none."""
    B: float = 0.0
    C: float = 0.0
    D: float = 0.0
    E: float = 0.0
    relaxation_length: float = 0.0
    """Relaxation length [m]."""
    damping_time: float = 0.0
    """Damping time [s]."""
    mu: float = 0.0
    """F/F_N in full sliding by the creep ratio."""
    creep_stiffness: float = 0.0
    """Slope of F/F_N over the creep ratio at zero."""
    load_exponent: float = 1.0
    """p of F ∝ F_N^p."""
    reference_load: float = 1.0
    """F_N at which the parameters are stated [N]; without effect if p = 1."""
    turnover: float = 0.0
    """Share of LuGre's bristles that leaves the contact per distance rolled κ [1/m]."""
    rolling_resistance: float = 0.0
    """μ_r of the dry force μ_r F_N against the direction in which the contact rolls."""
    roller_resistance: float = 0.0
    """μ_rr, by which the resistance to the rolling of the rollers exceeds that of the wheel."""
    roller_dry: float = 0.0
    """μ_rd of the dry force μ_rd F_N that the floor adds to the friction of the rollers."""


TRACTION_SIZE = len(TractionParameters._fields)
"""Length of a packed traction law."""


@dataclass(frozen=True)
class Floor:
    """A floor and its traction law."""

    name: str
    description: str
    law: str
    """One of `LAWS`."""
    source: str
    numbers: Mapping[str, float]
    """Parameters of the law, and those of `OPTIONAL` that the floor has, by their names in `floors.toml`."""
    uncertainty: float = 0.0
    """Relative half-width of the interval of each parameter; 0: taken as exact."""

    @property
    def traction(self) -> TractionParameters:
        """Traction law as the kernels of `physics.traction` take it."""
        return TractionParameters(float(LAWS[self.law][0]), **self.numbers)

    @property
    def row(self) -> np.ndarray:
        """Packed `traction`, shape (TRACTION_SIZE,)."""
        return np.array(self.traction)


def number_rules(law: str) -> dict[str, Rule]:
    """Rules of all parameters that a floor with this law may have, by name.

    Args:
      law: One of `LAWS`.
    """
    return {**LAWS[law][1], **OPTIONAL_OF_LAW.get(law, {}), **OPTIONAL}


def _read_floor(place: str, name: str, table: object) -> Floor:
    if not isinstance(table, Mapping):
        raise InputError(place, "is not a table")
    law = table.get("law")
    if law is None:
        raise InputError(f"{place}.law", "is missing", "a floor has a traction law", LAWS)
    law = check_choice(f"{place}.law", law, LAWS, "traction law")
    needed = ("description", "law", "source", *LAWS[law][1])
    known = tuple(dict.fromkeys((*needed, *number_rules(law), "uncertainty")))
    require_keys(place, table, known)
    for key in needed:
        if key not in table:
            raise InputError(place, f"'{key}' is missing")
    for key in ("description", "source"):
        if not isinstance(table[key], str):
            raise InputError(f"{place}.{key}", f"found {table[key]!r}", "a string is needed")
    if ("load_exponent" in table) != ("reference_load" in table):
        absent = "reference_load" if "load_exponent" in table else "load_exponent"
        raise InputError(place, f"'{absent}' is missing", "load_exponent and reference_load go together")
    rules = number_rules(law).items()
    numbers = {key: check_number(f"{place}.{key}", table[key], rule) for key, rule in rules if key in table}
    uncertainty = float(check_number(f"{place}.uncertainty", table.get("uncertainty", 0.0), _SHARE))
    return Floor(name, table["description"], law, table["source"], MappingProxyType(numbers), uncertainty)


def read_floors(path: Path | str | None = None) -> dict[str, Floor]:
    """Read a floors file.

    Args:
      path: A floors file; the shipped one when None.

    Returns:
      Floor by name, in the order of the file.

    Raises:
      InputError: A value is missing or breaks its rule.
      UnknownNameError: A law or key that does not exist.
    """
    path = models_folder() / "floors.toml" if path is None else Path(path)
    return {name: _read_floor(f"{path}: {name}", name, table) for name, table in read_toml(path).items()}


def all_floors(*own: Path | str | None) -> dict[str, Floor]:
    """Shipped floors by name, together with those of other files, which replace floors of the same name.

    Args:
      own: Floors files, of which later ones replace floors of those before; None for no file.

    Raises:
      InputError: A value is missing or breaks its rule.
      UnknownNameError: A law or key that does not exist.
    """
    floors = read_floors()
    for file in own:
        floors |= read_floors(file) if file is not None else {}
    return floors


def own_floors(file: Path | str | None) -> frozenset[str]:
    """Names of the floors of a user's file, none without a file: the robust method expects their creep.

    Raises:
      InputError: A value is missing or breaks its rule.
      UnknownNameError: A law or key that does not exist.
    """
    return frozenset(read_floors(file)) if file is not None else frozenset()


def find_floor(name: object, place: str, floors: Mapping[str, Floor] | None = None) -> Floor:
    """Look up a floor by name.

    Args:
      name: Name as written by the user.
      place: Origin of the name, for the message.
      floors: Known floors; the shipped ones when None.

    Raises:
      UnknownNameError: No such floor; the message lists the known ones.
    """
    floors = read_floors() if floors is None else floors
    if not isinstance(name, str) or name not in floors:
        raise UnknownNameError(place, "floor", name, floors)
    return floors[name]


def printable_line(words: str) -> str:
    """Remove line breaks and control characters, so that the text fits a TOML comment or string."""
    return "".join(sign if sign.isprintable() else "?" for sign in words)


def format_floor(floor: Floor, remarks: Iterable[str] = ()) -> str:
    """Format a floor as a TOML entry that `read_floors` accepts.

    Args:
      floor: Floor, whose parameters are written with six digits.
      remarks: Comments above the parameters, one line each.
    """
    lines = [f"[{floor.name}]", f"description = {_toml_text(floor.description)}", f'law = "{floor.law}"']
    lines += [f"source = {_toml_text(floor.source)}", f"uncertainty = {floor.uncertainty:.3g}"]
    lines += [f"# {printable_line(remark)}" for remark in remarks]
    lines += [f"{name} = {value:.{_DIGITS}g}" for name, value in floor.numbers.items()]
    return "\n".join(lines) + "\n"


def _toml_text(words: str) -> str:
    return json.dumps(printable_line(words), ensure_ascii=False)
