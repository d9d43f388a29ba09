"""The `[diagnosis]` table of a scenario: which form of a method to use."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from omnimj.control.published.choice import FLAGS, Choice, checked_choice
from omnimj.errors import InputError, UnknownNameError

DIAGNOSIS_KEYS = ("variant", "thresholds", *FLAGS)


def read_diagnosis(table: Any, place: str) -> Choice:
    """The form of a method; each key may be left out.

    `variant` and `thresholds` are those of `--method published`, `self_test` and `dither` of `--method
    robust`; `recovery` is for both.

    Raises:
      InputError: Not a table, or a flag is neither true nor false.
      UnknownNameError: A key, variant or set of thresholds that does not exist.
    """
    if not isinstance(table, Mapping):
        raise InputError(place, f"found {table!r}", "a table is needed", DIAGNOSIS_KEYS)
    for key in table:
        if key not in DIAGNOSIS_KEYS:
            raise UnknownNameError(place, "key", key, DIAGNOSIS_KEYS)
    usual = Choice()
    return checked_choice(
        table.get("variant", usual.variant),
        table.get("thresholds", usual.thresholds),
        {name: table[name] for name in FLAGS if name in table},
        place,
    )
