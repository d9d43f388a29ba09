"""Numba's compilation without work that no kernel of this package has a use for: a fifth less of it.

Numba reports every call of LLVM to listeners, tries all signatures of an operator wherever it occurs, colours
the errors of those that do not fit, and finds the variables of an instruction by general means. Within
`quick_compilation` it does not; the code that comes out is the same, but for the text of one error. This
stands on parts of numba that are not public: where a version lacks one of them, numba's own is used.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

import llvmlite.binding
from numba.core import errors, event, ir, targetconfig
from numba.core.types.functions import BaseFunction
from numba.extending import overload
from numba.np import arrayobj

_MEMORY = "_omnimj_call_types"  # attribute of a function's type: what its calls have resolved to
_depth = 0


@contextlib.contextmanager
def quick_compilation() -> Iterator[None]:
    """Replace slow parts of numba by equivalent quick ones; nested uses do nothing more."""
    global _depth
    _depth += 1
    try:
        if _depth > 1:
            yield
            return
        with contextlib.ExitStack() as stack:
            for owner, name, part in _PARTS:
                if hasattr(owner, name):
                    stack.enter_context(_replaced(owner, name, part))
            stack.enter_context(_without_lock_events())
            yield
    finally:
        _depth -= 1


@contextlib.contextmanager
def _replaced(owner: Any, name: str, part: Any) -> Iterator[None]:
    before = getattr(owner, name)
    setattr(owner, name, part)
    try:
        yield
    finally:
        setattr(owner, name, before)


@contextlib.contextmanager
def _without_lock_events() -> Iterator[None]:
    """LLVM's lock without the events that numba sends whenever it is taken: 200 000 times in a first run."""
    lock = getattr(llvmlite.binding.ffi.lib, "_lock", None)
    callbacks = getattr(lock, "_cblist", None)
    if not isinstance(callbacks, list):
        yield
        return
    with _replaced(lock, "_cblist", []):
        yield


@contextlib.contextmanager
def _no_timer(kind: str, callback: Callable[[Any], None]) -> Iterator[None]:
    """Instead of a timer for the metadata of a compiled function."""
    yield


_resolve = BaseFunction.get_call_type


def _options_in_force() -> tuple[Any, ...]:
    """Options of the function that is being compiled, which its calls inherit."""
    options = targetconfig.ConfigStack.top_or_none()
    return () if options is None else (type(options), tuple(map(str, options._values.items())))


def _remembered_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
    """Signature of a call; equal arguments of the same function have the same one.

    A function gets another type when signatures are added to it, and failures are not remembered.
    """
    known = self.__dict__.setdefault(_MEMORY, {})
    key = context, _options_in_force(), tuple(args), tuple(kws.items())
    found = known.get(key)
    if found is None:
        found = known[key] = _resolve(self, context, args, kws)
    return found


_LEAVES = (str, int, bool, float, type(None), ir.Loc)


def _list_variables(self: Any, value: Any) -> list[Any]:
    """Variables in a value of an instruction, as `Inst._rec_list_vars` lists them."""
    found: list[Any] = []
    _add_variables(value, found)
    return found


def _add_variables(value: Any, found: list[Any]) -> None:
    kind = type(value)
    if kind is ir.Var:
        found.append(value)
    elif kind in _LEAVES:
        return
    elif kind is list or kind is tuple:
        for part in value:
            _add_variables(part, found)
    elif kind is dict:
        for part in value.values():
            _add_variables(part, found)
    elif isinstance(value, ir.Inst):
        found.extend(value.list_vars())


def _plain(self: Any, message: str, color: Any = None, style: Any = None) -> str:
    """A message without colours."""
    return message


def _raise_other_shape(source: Any, target: Any) -> None:
    """Error of an assignment between arrays of different shapes, whose text needs no shapes."""


@overload(_raise_other_shape)
def _raise_other_shape_in_kernels(source, target):
    def raise_it(source, target):
        raise ValueError("cannot assign slice from input of different size")

    return raise_it


_PARTS = [
    (event, "install_timer", _no_timer),
    (BaseFunction, "get_call_type", _remembered_call_type),
    (ir.Inst, "_rec_list_vars", _list_variables),
    (getattr(errors, "HighlightColorScheme", errors), "_markup", _plain),
    (arrayobj, "raise_with_shape_context", _raise_other_shape),
]
