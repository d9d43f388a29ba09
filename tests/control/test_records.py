from typing import NamedTuple

import numpy as np
import pytest
from numba.core.errors import TypingError

from omnimj.control.records import copied, opened, packed
from omnimj.physics.native import kernel
from omnimj.signals import Array


class Wheel(NamedTuple):
    speed: Array
    matrix: Array
    seen: Array
    count: int


class Machine(NamedTuple):
    mass: float
    wheel: Wheel
    stands: bool
    force: Array


def machine(n):
    rng = np.random.default_rng(n)
    wheel = Wheel(rng.normal(size=n), rng.normal(size=(3, n)), np.arange(n) % 2 == 0, 7)
    return Machine(2.5, wheel, True, rng.normal(size=2))


@kernel
def _double(record):
    x = opened(record[0], Machine)
    x.wheel.matrix[:] *= 2.0
    x.wheel.speed[0] = x.mass + x.force[1] + x.wheel.count + x.wheel.seen.sum()


@kernel
def _sum(wheel):
    return wheel.matrix.sum() + wheel.speed.sum()


@kernel
def _sum_of(record):
    return _sum(opened(record[0], Machine).wheel)


@kernel
def _after_a_change(record):
    x = opened(record[0], Machine)
    stood = x.stands
    record[0].mass, record[0].stands = x.mass + 1.0, False
    return x.mass, stood, x.stands


@kernel
def _unknown_field(record):
    return opened(record[0], Machine).weight


@pytest.mark.parametrize("n", [3, 4])
def test_an_opened_record_has_the_fields_that_were_packed(n):
    record = packed(machine(n))
    for field, before in zip(opened(record[0], Machine).wheel, machine(n).wheel, strict=True):
        assert np.array_equal(field, before)
    assert opened(record[0], Machine).mass == 2.5


def test_kernels_change_a_record_through_its_views_as_python_does():
    by_kernel, by_hand = packed(machine(4)), packed(machine(4))
    _double(by_kernel)
    x = opened(by_hand[0], Machine)
    x.wheel.matrix[:] *= 2.0
    x.wheel.speed[0] = x.mass + x.force[1] + x.wheel.count + x.wheel.seen.sum()
    assert by_kernel.tobytes() == by_hand.tobytes() != packed(machine(4)).tobytes()


def test_kernels_pass_on_parts_of_records_of_any_size():
    for n in (3, 4):
        wheel = machine(n).wheel
        assert _sum_of(packed(machine(n))) == pytest.approx(wheel.matrix.sum() + wheel.speed.sum())


def test_a_view_reads_the_record_as_it_is_now():
    record = packed(machine(4))
    assert _after_a_change(record) == (3.5, True, False)
    assert record["mass"][0] == 3.5 and not record["stands"][0]


def test_a_field_that_a_record_has_not_is_refused_by_name():
    with pytest.raises(TypingError, match="weight"):
        _unknown_field(packed(machine(4)))


def test_a_copy_is_apart_from_its_record_and_of_the_very_same_type():
    record = packed(machine(4))
    copy = copied(record)
    assert copy.tobytes() == record.tobytes() and copy.dtype is record.dtype
    copy["mass"] = 3.0
    assert record["mass"][0] == 2.5
