import numba
import numpy as np
import pytest
from numba.core import event, ir, types
from numba.core.compiler import run_frontend
from numba.core.errors import TypingError
from numba.core.registry import cpu_target
from numba.core.types.functions import BaseFunction

from omnimj.control.detection.robust import evidence, glr, judgement
from omnimj.control.recovery import step as recovery
from omnimj.physics.compilation import quick_compilation
from omnimj.physics.native import kernel

KERNELS = [
    evidence.update_evidence,
    glr.likelihood_ratios,
    judgement.judge_block,
    recovery.advance_recovery,
]


@pytest.mark.parametrize("compiled", KERNELS, ids=lambda compiled: compiled.py_func.__name__)
def test_instructions_have_the_variables_that_numba_finds(compiled):
    statements = [
        statement for block in run_frontend(compiled.py_func).blocks.values() for statement in block.body
    ]
    by_numba = [[variable.name for variable in statement.list_vars()] for statement in statements]
    with quick_compilation():
        quickly = [[variable.name for variable in statement.list_vars()] for statement in statements]
    assert quickly == by_numba and any(by_numba)


@pytest.mark.parametrize("function", [np.add, np.dot, np.empty, abs, max], ids=lambda f: f.__name__)
@pytest.mark.parametrize("kind", [types.float64, types.int64, types.float64[::1], types.boolean])
def test_a_call_has_the_signature_that_numba_finds(function, kind):
    context = cpu_target.typing_context
    context.refresh()
    resolved = context.resolve_value_type(function)
    for arguments in ((kind,), (kind, kind), (kind, types.float64)):
        assert _signature(context, resolved, arguments) == _signature(context, resolved, arguments, True)


def _signature(context, resolved, arguments, quickly=False):
    try:
        if not quickly:
            return resolved.get_call_type(context, arguments, {})
        with quick_compilation():
            twice = [resolved.get_call_type(context, arguments, {}) for _ in range(2)]
        assert twice[0] == twice[1]
        return twice[0]
    except TypingError:
        return None


def test_numba_is_as_it_was_after_a_compilation_that_fails():
    parts = event.install_timer, BaseFunction.get_call_type, ir.Inst._rec_list_vars

    @kernel
    def broken(x):
        return x.no_such_attribute

    with pytest.raises(TypingError, match="no_such_attribute"):
        broken(1.0)
    assert parts == (event.install_timer, BaseFunction.get_call_type, ir.Inst._rec_list_vars)


def test_a_slice_takes_no_array_of_another_size():
    @kernel
    def assign(target, source):
        target[:] = source
        return target.sum()

    assert assign(np.zeros(3), np.arange(3.0)) == 3.0
    with pytest.raises(ValueError, match="size"):
        assign(np.zeros(3), np.zeros(2))


def test_kernels_of_others_keep_their_options():
    fast = numba.njit(fastmath=True)(lambda x: x + 1.0)
    exact = kernel(lambda x: x + 1.0)
    assert fast(1.0) == exact(1.0) == 2.0
    assert " fast " in next(iter(fast.inspect_llvm().values()))
    assert " fast " not in next(iter(exact.inspect_llvm().values()))
