"""Robots side by side do what each does alone, in every mode of autoreset."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode

from omnimj.errors import InputError
from omnimj.learning import ENVIRONMENT

# episodes that end by themselves, and some by leaving the plan
OPTIONS = {"duration": 3.0, "decision_period": 0.3, "largest_error": 0.2}


def vector(count=3, **options) -> Any:
    return gymnasium.make_vec(ENVIRONMENT, num_envs=count, **{"plant": "planar", **OPTIONS, **options})


def serial(count=3, mode=AutoresetMode.NEXT_STEP, **options) -> Any:
    return gymnasium.make_vec(
        ENVIRONMENT,
        num_envs=count,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": mode},
        **{"plant": "planar", **OPTIONS, **options},
    )


def assert_same(one, other, place=""):
    assert type(one) is type(other), place
    if isinstance(one, dict):
        assert set(one) == set(other), place
        for key in one:
            assert_same(one[key], other[key], f"{place}/{key}")
    elif isinstance(one, np.ndarray) and one.dtype == object:
        for a, b in zip(one, other, strict=True):
            assert_same(a, b, place)
    elif isinstance(one, np.ndarray):
        assert one.dtype == other.dtype and np.array_equal(one, other), place
    elif isinstance(one, tuple):
        for a, b in zip(one, other, strict=True):
            assert_same(a, b, place)
    else:
        assert one == other, place


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["planar", "twin"])
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_robots_do_together_what_they_do_alone(plant, mode):
    mine, reference = vector(plant=plant, autoreset_mode=mode), serial(mode=mode, plant=plant)
    assert_same(mine.reset(seed=7), reference.reset(seed=7), "reset")
    draws, ends = np.random.default_rng(1), np.zeros(2, int)
    for k in range(24):
        actions = draws.uniform(-1, 1, (3, 3)).astype(np.float32)
        found, expected = mine.step(actions), reference.step(actions)
        assert_same(found, expected, f"step {k}")
        ends += found[2].sum(), found[3].sum()
    assert ends.min() > 0  # both kinds of end have been met
    assert mine.metadata["autoreset_mode"] is mode
    assert_same(mine.reset(), reference.reset(), "later reset")
    mine.close()


def test_without_autoreset_a_mask_begins_episodes_again():
    mine = vector(autoreset_mode="Disabled", largest_error=10.0)
    reference = serial(mode=AutoresetMode.DISABLED, largest_error=10.0)
    with pytest.raises(ResetNeeded):
        mine.step(np.zeros((3, 3)))
    assert_same(mine.reset(seed=[4, 5, 6]), reference.reset(seed=[4, 5, 6]))
    for _ in range(10):
        found = mine.step(np.zeros((3, 3), np.float32))
        assert_same(found, reference.step(np.zeros((3, 3), np.float32)))
    assert found[3].all()
    with pytest.raises(ResetNeeded):
        mine.step(np.zeros((3, 3)))
    for mask in ([True, False, True], [False, True, False]):
        options = {"reset_mask": np.array(mask)}
        assert_same(mine.reset(options=dict(options)), reference.reset(options=dict(options)))
    assert_same(mine.step(np.ones((3, 3), np.float32)), reference.step(np.ones((3, 3), np.float32)))


def test_the_number_of_threads_changes_nothing():
    found = []
    for threads in (1, 2, 4):
        many = vector(8, threads=threads)
        many.reset(seed=2)
        found.append([many.step(np.full((8, 3), 0.3)) for _ in range(12)])
    for others in found[1:]:
        assert_same(tuple(others), tuple(found[0]))


def test_its_spaces_and_pictures_are_those_of_the_robots():
    many = vector(2, render_mode="rgb_array")
    seen, _ = many.reset(seed=1)
    assert seen in many.observation_space and many.observation_space.shape == (2, 20)
    assert many.action_space.shape == (2, 3)
    many.step(np.zeros((2, 3)))
    pictures = many.render()
    assert len(pictures) == 2 and pictures[0].shape == (480, 480, 3)
    assert vector(2).render() is None
    assert many.np_random_seed == (1, 2) and len(many.np_random) == 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"count": 0}, "num_envs: found 0; must be at least 1"),
        ({"threads": 1.5}, "threads: found 1.5; must be a whole number"),
        ({"autoreset_mode": "never"}, "unknown mode 'never'"),
        ({"floor": "pcv"}, "unknown floor 'pcv'"),
    ],
)
def test_a_bad_option_is_one_clear_line(options, message):
    with pytest.raises(InputError) as caught:
        vector(**options)
    assert message in str(caught.value)


def test_bad_seeds_masks_and_actions_are_refused():
    many = vector(2)
    assert len(many.np_random) == 2
    with pytest.raises(ResetNeeded):
        many.step(np.zeros((2, 3)))
    with pytest.raises(ResetNeeded):
        many.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(InputError, match="seed: found 1 seeds; 2 are needed"):
        many.reset(seed=[1])
    with pytest.raises(InputError, match="reset_mask"):
        many.reset(options={"reset_mask": [True, False]})
    many.reset(seed=1)
    with pytest.raises(InputError, match=r"action: found shape \(3,\); shape \(2, 3\)"):
        many.step(np.zeros(3))
