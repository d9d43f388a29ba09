"""Machine code for the kernels that Python or MuJoCo call, and for no others.

Numba optimizes every kernel together with all kernels that it calls, and translates the whole into machine
code: a kernel below ten others is optimized and translated eleven times, of which one is executed. Within
`deferred_translation` a compiled function waits until somebody asks for its address. Until then it is only
linked, as it is, into those that call it, and the cache on disk keeps it in this form. This stands on parts
of numba that are not public: a version without them compiles as it always does, to the same numbers.
"""

from __future__ import annotations

import contextlib
import functools
import threading
from collections.abc import Iterator
from typing import Any

from llvmlite import binding
from numba.core.codegen import JITCodeLibrary
from numba.core.environment import lookup_environment
from numba.core.registry import cpu_target
from numba.core.runtime.context import NRTContext

_ENVIRONMENT = "_ZN08NumbaEnv"  # prefix of the variables that hold the environments of functions
_CALLBACK = "cfunc."  # prefix of the functions that C calls, which are saved before anybody asks for them
_ROUNDS = 4  # of optimization: what one round inlines, the next one simplifies and inlines further
_SMALL = 300_000  # [bytes] of bitcode up to which rounds cost little, as of what MuJoCo calls in every step
_STATE = threading.local()
_PARTS = [  # of numba's own that the deferred library overrides or calls
    "_optimize_functions",
    "_optimize_final_module",
    "_finalize_final_module",
    "_finalize_dynamic_globals",
    "_verify_declare_only_symbols",
    "_ensure_finalized",
    "get_defined_functions",
    "get_pointer_to_function",
    "serialize_using_bitcode",
    "serialize_using_object_code",
]


class DeferredLibrary(JITCodeLibrary):
    """Code library that is optimized and translated when the address of a function is asked for."""

    _deferred = False

    def _optimize_final_module(self) -> None:
        """Leave it to `_translate`, and to the libraries into which this one is linked."""

    def _finalize_final_module(self) -> None:
        if self._object_caching_enabled and self._compiled_object is not None:  # machine code of the cache
            super()._finalize_final_module()
            return
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._deferred = self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Address of a function of this library, 0 if there is none of this name."""
        self._ensure_finalized()
        if self._deferred:
            if not self._defines(name):
                return 0
            self._translate(name)
        return super().get_pointer_to_function(name)

    def _defines(self, name: str) -> bool:
        try:
            return not self._final_module.get_function(name).is_declaration
        except NameError:
            return False

    def _optimize_functions(self, ll_module: Any) -> None:
        """Simplify the functions of a module; numba prepares passes for those declared only, too."""
        ll_module.data_layout = self._codegen._data_layout
        for function in ll_module.functions:
            if not function.is_declaration:
                passes, builder = self._codegen._function_pass_manager()
                passes.run(function, builder)

    def _translate(self, entry: str) -> None:
        self._deferred = False
        for function in self.get_defined_functions():  # known to be called from nowhere else
            if function.linkage == binding.Linkage.linkonce_odr and function.name != entry:
                function.linkage = binding.Linkage.internal
        rounds = _ROUNDS if len(self._final_module.as_bitcode()) < _SMALL else 1
        for _ in range(rounds):
            super()._optimize_final_module()
        self._final_module.verify()
        super()._finalize_final_module()
        for variable in self._final_module.global_variables:
            if variable.name.startswith(_ENVIRONMENT):
                environment = lookup_environment(variable.name)
                if environment is not None:
                    self._codegen.set_env(variable.name, environment)

    def serialize_using_object_code(self) -> tuple[str, str, Any]:
        """Contents for the cache: machine code of what C or Python calls, else what callers link."""
        self._ensure_finalized()
        names = [function.name for function in self.get_defined_functions()]
        for name in filter(lambda name: name.startswith(_CALLBACK), names):
            self.get_pointer_to_function(name)
        return self.serialize_using_bitcode() if self._deferred else super().serialize_using_object_code()


@contextlib.contextmanager
def deferred_translation() -> Iterator[None]:
    """Compile, or load, without machine code until somebody asks for an address."""
    before = getattr(_STATE, "deferring", False)
    _STATE.deferring = _prepare_numba()
    try:
        yield
    finally:
        _STATE.deferring = before


@functools.cache
def _prepare_numba() -> bool:
    """Let numba make deferred libraries, whose environments wait for their variables; False if it cannot."""
    if not _is_known():
        return False
    codegen = cpu_target.target_context.codegen()
    create_library, set_env, engine = codegen.create_library, codegen.set_env, codegen._engine

    def create(name: str, **options: Any) -> Any:
        if getattr(_STATE, "deferring", False):
            return DeferredLibrary(codegen, name, **options)
        return create_library(name, **options)

    def set_known_env(name: str, environment: Any) -> None:
        if engine.is_symbol_defined(name):
            set_env(name, environment)

    codegen.create_library, codegen.set_env = create, set_known_env
    NRTContext.get_meminfos = _get_meminfos
    return True


def _is_known() -> bool:
    """True if this version of numba has all the parts that deferring stands on."""
    codegen = cpu_target.target_context.codegen()
    parts = all(hasattr(JITCodeLibrary, part) for part in _PARTS)
    return parts and hasattr(codegen, "_engine") and hasattr(NRTContext, "get_meminfos")


def _get_meminfos(nrt: Any, builder: Any, kind: Any, value: Any) -> list[tuple[Any, Any]]:
    """Types and reference counters inside a value, as `NRTContext.get_meminfos` lists them.

    Numba's own reads every shape, stride and number of a record of arrays to find that they are not counted,
    wherever the record is used: two thirds of the instructions of the largest kernels.
    """
    model = nrt._context.data_model_manager[kind]
    found = [(kind, model.get_nrt_meminfo(builder, value))] if model.has_nrt_meminfo() else []
    for member, read in model.traverse(builder):
        if _is_counted(nrt._context.data_model_manager, member):
            found.extend(_get_meminfos(nrt, builder, member, read(value)))
    return found


@functools.cache
def _is_counted(models: Any, kind: Any) -> bool:
    """True if values of a type contain counters of references."""
    return models[kind].contains_nrt_meminfo()
