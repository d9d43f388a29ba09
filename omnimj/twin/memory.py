"""Reads and writes memory by address inside kernels; addresses are integers."""

from __future__ import annotations

from typing import Any

import numba.extending
from llvmlite import ir
from numba import types
from numba.core import cgutils

# the decorator takes the typing context away, which type checkers cannot see
intrinsic: Any = numba.extending.intrinsic


def _element(builder, address, index, element, width):
    byte = builder.add(address, builder.mul(index, ir.Constant(ir.IntType(64), width)))
    return builder.inttoptr(byte, element.as_pointer())


@intrinsic
def load_pointer(typingctx, address):
    """The pointer stored at `address`."""

    def codegen(context, builder, signature, arguments):
        return builder.load(builder.inttoptr(arguments[0], ir.IntType(64).as_pointer()))

    return types.int64(types.int64), codegen


@intrinsic
def load_real(typingctx, address, index):
    """Element `index` of an array of doubles at `address`."""

    def codegen(context, builder, signature, arguments):
        return builder.load(_element(builder, arguments[0], arguments[1], ir.DoubleType(), 8))

    return types.float64(types.int64, types.int64), codegen


@intrinsic
def load_int(typingctx, address, index):
    """Element `index` of an array of 32-bit integers at `address`, as a 64-bit integer."""

    def codegen(context, builder, signature, arguments):
        found = builder.load(_element(builder, arguments[0], arguments[1], ir.IntType(32), 4))
        return builder.sext(found, ir.IntType(64))

    return types.int64(types.int64, types.int64), codegen


@intrinsic
def store_real(typingctx, address, index, value):
    """Writes a double to element `index` of an array at `address`."""

    def codegen(context, builder, signature, arguments):
        target = _element(builder, arguments[0], arguments[1], ir.DoubleType(), 8)
        builder.store(arguments[2], target)
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.float64), codegen


@intrinsic
def real_pointer(typingctx, address):
    """`address` as a pointer to doubles, for `numba.carray`."""

    def codegen(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], ir.DoubleType().as_pointer())

    return types.CPointer(types.float64)(types.int64), codegen


@intrinsic
def stack_reals(typingctx, count):
    """Room for `count` doubles (a constant) on the stack of the calling kernel, valid until it returns."""
    literal = count.literal_value if isinstance(count, types.Literal) else None
    if literal is None:
        return None

    def codegen(context, builder, signature, arguments):
        room = cgutils.alloca_once(builder, ir.ArrayType(ir.DoubleType(), literal))
        return builder.bitcast(room, ir.DoubleType().as_pointer())

    return types.CPointer(types.float64)(count), codegen
