"""Records for kernels that run at every control step: NamedTuples packed into structured arrays.

Numba takes NamedTuples as arguments, but examines each of their fields at every call and makes a Python
object of each array that it returns. A structured array of one record costs as little as any other array,
keeps the names (`record.period`, `record.limits.change`), nested tuples and arrays included, and has room for
many records: one per trial of a batch.
"""

from __future__ import annotations

import functools
import hashlib
from typing import Any, get_type_hints

import numpy as np
from numba.core import cgutils, types
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, intrinsic, lower_getattr_generic, models, overload, register_model
from numba.np.arrayobj import make_array, populate_array
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


_DOUBLE = np.dtype(np.float64)
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


def plain_array(values: Any) -> NDArray[np.float64]:
    """The numbers as a writable, contiguous float64 array; the same array if it is one already.

    Numba compiles a kernel anew for every other type or layout of an argument, such as a strided view,
    integers or a read-only buffer. That takes thousands of control periods.
    """
    if type(values) is np.ndarray and values.dtype == _DOUBLE and values.flags.carray:
        return values
    return np.array(values, np.float64, order="C")


def copied(record: Record) -> Record:
    """Copy of a record, or of an array of records, with the very same dtype object.

    numpy copies nested records field by field, and numba looks up the type of an equal but not identical
    dtype slowly: both cost several microseconds a step.
    """
    return np.frombuffer(bytearray(record.view(np.uint8)), record.dtype)


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


@functools.cache
def _nested(kind: Any) -> dict[str, Any]:
    """NamedTuples among the fields of a NamedTuple."""
    hints = get_type_hints(kind)
    return {name: hints[name] for name in kind._fields if hasattr(hints[name], "_fields")}


def opened(record: Any, kind: Any) -> Any:
    """Fields of a record as the NamedTuple that it was packed from; arrays are views.

    Inside kernels the result is a `RecordView`, whose fields have the same names.

    Args:
      record: Element of a `Record`, `record[0]`; outside of kernels also the `Record`, which takes half the
        time.
      kind: Class of the NamedTuple, whose masks are arrays of 0 and 1; outside of kernels its numbers are
        copied.
    """
    nested, is_element = _nested(kind), not isinstance(record, np.ndarray)
    fields = []
    for name in kind._fields:
        field = record[name]
        if name in nested:
            field = opened(field, nested[name])
        fields.append(field if is_element or name in nested else field[0])
    return kind._make(fields)


class RecordView(types.Type):
    """Numba's type of an opened record: an address, whose layout belongs to the type.

    A NamedTuple of arrays goes from kernel to kernel as hundreds of numbers, a view as one, and the compiler
    knows the shapes. In return kernels are compiled for each number of wheels.
    """

    def __init__(self, record: types.Record, kind: Any) -> None:
        self.record, self.kind = record, kind
        layout = hashlib.sha256(str(record).encode()).hexdigest()[:12]
        super().__init__(f"RecordView({kind.__module__}.{kind.__qualname__}.{layout})")

    def field_type(self, name: str) -> Any:
        """Type of a field: view, array or number."""
        field, nested = self.record.typeof(name), _nested(self.kind)
        if name in nested:
            return _view_type(field, nested[name])
        return types.Array(field.dtype, field.ndim, "C") if isinstance(field, types.NestedArray) else field


_view_type = functools.cache(RecordView)


@register_model(RecordView)
class _RecordViewModel(models.OpaqueModel):
    """An address."""


@overload(opened)
def _opened_in_kernels(record, kind):
    if isinstance(record, types.Record) and isinstance(kind, types.NamedTupleClass):
        return lambda record, kind: _view(record, kind)
    return None


_intrinsic: Any = intrinsic  # hides signatures from type checkers


@_intrinsic
def _view(typingctx, record, kind):
    view = _view_type(record, kind.instance_class)

    def codegen(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], context.get_value_type(view))

    return view(record, kind), codegen


@infer_getattr
class _RecordViewAttributes(AttributeTemplate):
    key = RecordView

    def generic_resolve(self, view, name):
        """Type of a field, None if there is none of this name."""
        return view.field_type(name) if name in view.kind._fields else None


@lower_getattr_generic(RecordView)
def _read_field(context, builder, view, value, name):
    field, wanted = view.record.typeof(name), view.field_type(name)
    place = cgutils.pointer_add(builder, value, context.get_constant(types.intp, view.record.offset(name)))
    if isinstance(wanted, RecordView):
        return place
    if isinstance(wanted, types.Array):
        return _array_at(context, builder, field, wanted, place)
    number = builder.bitcast(place, context.get_data_type(wanted).as_pointer())
    return context.unpack_value(builder, wanted, number)


def _array_at(context, builder, field, wanted, place):
    """Code for a view of the array at an address, with the shape and strides of the field."""
    number = context.get_data_type(wanted.dtype)
    view = make_array(wanted)(context, builder)
    lengths, strides = (
        cgutils.pack_array(builder, [context.get_constant(types.intp, k) for k in numbers])
        for numbers in (field.shape, field.strides)
    )
    populate_array(
        view,
        data=builder.bitcast(place, number.as_pointer()),
        shape=lengths,
        strides=strides,
        itemsize=context.get_constant(types.intp, context.get_abi_sizeof(number)),
        meminfo=None,
        parent=None,
    )
    return view._getvalue()
