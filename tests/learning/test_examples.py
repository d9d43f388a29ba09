"""The example of the documentation learns, and says what it has learned."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import omnimj


@pytest.fixture(scope="module")
def example() -> Any:
    path = Path(omnimj.__file__).parent / "docs" / "examples" / "feed_forward.py"
    spec = importlib.util.spec_from_file_location("feed_forward", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look for it there
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


@pytest.mark.slow
def test_a_few_generations_already_follow_the_plan_more_closely(example, tmp_path, capsys):
    out = tmp_path / "policy.json"
    example.main(
        ["--generations", "3", "--missions", "2", "--duration", "3.5", "--seed", "2", "--out", str(out)]
    )
    printed = capsys.readouterr().out
    assert "seed 2: 3 generations of 16 drives on natural_stone" in printed and "\ntwin: 2 other" in printed
    weights = np.array(list(json.loads(out.read_text()).values()))
    alone, learned = (example.judge(one, "planar", 2, 3.5) for one in (np.zeros(6), weights))
    assert learned.tracking.mean() < alone.tracking.mean()
    assert f"{1e3 * learned.tracking.mean():.2f}" in printed


@pytest.mark.slow
def test_the_seed_determines_what_is_learned(example):
    first, again, other = (example.train(seed, 1, 3.0) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_weights_of_zero_add_nothing_and_the_policy_is_alike_along_x_and_y(example):
    draws = np.random.default_rng(0)
    seen = draws.uniform(-1, 1, (5, 20)).astype(np.float32)
    assert not example.act(np.zeros((5, 6)), seen).any()
    swapped = seen.copy()
    for word in ("target_velocity", "ahead_velocity", "behind"):
        x, y = (example._NAMES.index(f"{word}_{axis}") for axis in "xy")
        swapped[:, [x, y]] = seen[:, [y, x]]
    weights = np.full((5, 6), 0.1)
    np.testing.assert_array_equal(example.act(weights, seen)[:, [1, 0, 2]], example.act(weights, swapped))
