"""Records for kernels that run at every control step: NamedTuples packed into structured arrays.

Numba takes NamedTuples as arguments, but examines each of their fields at every call and makes a Python
object of each array that it returns. A structured array of one record costs as little as any other array,
keeps the names (`record.period`, `record.limits.change`), nested tuples and arrays included, and has room for
many records: one per trial of a batch.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Record = NDArray[np.void]
"""Structured array of one record, shape (1,)."""


def _field_type(value: Any) -> Any:
    if isinstance(value, tuple):
        return np.dtype([(name, _field_type(field)) for name, field in _fields(value)], align=True)
    if isinstance(value, np.ndarray):
        # numba knows no arrays of truth values inside records
        return (np.dtype(np.uint8) if value.dtype == bool else value.dtype, value.shape)
    return np.dtype(type(value))


_TYPES: dict[Any, Any] = {}


def _same_type(dtype: Any) -> Any:
    """The dtype object of the first record of this type.

    Numba knows types by the first dtype object that it met. It looks up an equal one by comparing all fields,
    10 µs for the state of a controller, at every call of a kernel.
    """
    return _TYPES.setdefault(dtype, dtype)


def _fields(value: Any) -> list[tuple[str, Any]]:
    return list(zip(value._fields, value, strict=True))


def packed(value: Any) -> Record:
    """Pack a NamedTuple of numbers, truth values, arrays and NamedTuples into a record.

    A kernel reads the fields of `record[0]` by the same names. Shapes of arrays are part of the record's
    type; masks become arrays of 0 and 1.
    """
    record: Any = np.zeros(1, _same_type(_field_type(value)))
    assign(record, value)
    return record


def copied(record: Record) -> Record:
    """Copy of a record, or of an array of records, with the very same dtype object.

    numpy copies nested records field by field, and numba looks up the type of an equal but not identical
    dtype slowly: both cost several microseconds a step.
    """
    return np.frombuffer(bytearray(record.tobytes()), record.dtype)


def packed_like(record: Record, value: Any) -> Record:
    """Pack a NamedTuple into a record of the same type as another one: quicker than `packed`."""
    after = copied(record)
    assign(after, value)
    return after


def assign(record: Any, value: Any) -> None:
    """Write the fields of a NamedTuple into a record of its type, or into a field of a record."""
    for name, field in _fields(value):
        if isinstance(field, tuple):
            assign(record[name], field)
        else:
            record[name] = field
