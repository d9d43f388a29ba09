import numpy as np
import pytest
from mismatch_scenes import CHANNELS, NOISE, coloured, mismatch, scene
from nightly import checkerboard, representative

from omnimj.estimate.gap.locate.regimes import EVERYWHERE, QUIET, locate
from omnimj.estimate.gap.locate.rules import round_between
from omnimj.estimate.replay.interface import Channel, Segment


def _located(signal, seed=0, **kind):
    segments, regimes = scene(seed, **kind)
    values = {name: column for name, (_, column) in regimes.items()}
    return locate(CHANNELS, segments, regimes, mismatch(signal(values), segments, seed), None, NOISE)


CAUSES = {
    "speed above": (lambda r: 8.0 * r["speed"], {}),
    "sideways motion, more in one sign: lateral speed below": (
        lambda r: 6.0 * (r["lateral_speed"] < -0.1) * r["speed"],
        {},
    ),
    "sideways motion, more in one sign": (
        lambda r: (
            10.0 * np.abs(r["lateral_speed"]) * np.where(r["lateral_speed"] < 0.0, 1.6, 1.0) * r["speed"]
        ),
        {},
    ),
    "sideways motion, alike in both signs": (lambda r: 10.0 * np.abs(r["lateral_speed"]) * r["speed"], {}),
    "around position 0.3": (lambda r: 8.0 * (np.abs(r["position"] - 0.4) < 0.05), {}),
    "near standstill, speed": (lambda r: 8.0 * (np.abs(r["speed"]) < 0.08), {"reversing": True}),
    "after a reversal": (
        lambda r: 8.0 * np.exp(-np.nan_to_num(r["reversal"], nan=9.0) / 0.08),
        {"reversing": True},
    ),
    "one direction, speed above": (lambda r: 8.0 * np.maximum(r["speed"], 0.0), {"reversing": True}),
    "acceleration (either sign) above": (lambda r: r["acceleration"], {"reversing": True}),
    "once per turn": (lambda r: 4.0 * np.cos(r["wheel_angle"] + 1.0), {}),
    "grows with time since start": (lambda r: 8.0 * r["time"], {}),
    "load above": (lambda r: 8.0 * (r["load"] > 3.0), {}),
    "on natural_stone and not on paperboard, pvc": (
        lambda r: 6.0 * (r["floor"] == "natural_stone") + 2.0 * (r["floor"] == "paperboard"),
        {"floors": ("natural_stone", "pvc", "paperboard"), "lateral": (0.0,)},
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("words", CAUSES)
@pytest.mark.parametrize("seed", [0, 1])
def test_the_first_place_names_the_regime_that_carries_the_mismatch(words, seed):
    signal, kind = CAUSES[words]
    first = _located(signal, seed, **kind)[0]
    assert first.channel == "carriage_speed"
    assert words in first.regime


@pytest.mark.parametrize(("seed", "correlation"), checkerboard(range(5), (0.0, 0.9)))
def test_noise_alone_is_located_nowhere(seed, correlation):
    segments, regimes = scene(seed)
    noise = coloured(np.random.default_rng(seed), segments, correlation)[:, None]
    places = locate(CHANNELS[:1], segments, regimes, noise, None, np.ones(1))
    assert [(p.regime, p.share) for p in places] == [(QUIET, 0.0)]


@pytest.mark.parametrize("seed", representative(*range(5), keep=2))
def test_a_mismatch_without_a_regime_is_everywhere_alike(seed):
    segments, regimes = scene(seed)
    random = np.random.default_rng(seed)
    offset = np.repeat(3.0 * random.normal(size=len(segments)), 60)
    for own in (3.0 * coloured(random, segments, 0.9), offset + coloured(random, segments)):
        places = locate(CHANNELS[:1], segments, regimes, own[:, None], None, np.ones(1))
        assert [p.regime for p in places] == [EVERYWHERE]
        assert places[0].share == pytest.approx(1.0)


def test_two_causes_are_two_places_that_do_not_overlap():
    places = _located(
        lambda r: 8.0 * (np.abs(r["position"] - 0.4) < 0.05) + 12.0 * np.abs(r["lateral_speed"])
    )
    own = [p for p in places if p.channel == "carriage_speed"]
    assert "sideways motion" in own[0].regime
    assert own[1].regime.startswith("elsewhere, around position 0.3")
    assert sum(p.share for p in places) <= 1.0 + 1e-9
    assert [p.share for p in places] == sorted((p.share for p in places), reverse=True)


def test_where_all_runs_move_sideways_the_sign_that_carries_more_is_named():
    places = _located(
        lambda r: 8.0 * np.where(r["lateral_speed"] < 0.0, 1.5, 1.0), lateral=(-0.5, -0.25, 0.25, 0.5)
    )
    assert places[0].regime.startswith("sideways motion, more in one sign")


def test_a_place_holds_the_rms_of_its_blocks_before_and_after():
    segments, regimes = scene(0)
    fast = regimes["speed"][1] > 0.8
    before = np.where(fast, 0.1, 0.0)[:, None] + 1e-4
    after = np.where(fast, 0.02, 0.5)[:, None]
    place = locate(CHANNELS[:1], segments, regimes, before, after, np.array([0.01]))[0]
    low, high = place.bounds["speed"]
    inside = (regimes["speed"][1] >= low) & (regimes["speed"][1] <= high)
    assert place.before == pytest.approx(np.sqrt((before[inside] ** 2).mean()))
    assert place.after == pytest.approx(np.sqrt((after[inside] ** 2).mean()))
    assert low == pytest.approx(0.8, abs=0.03)


def test_one_run_alone_is_named():
    segments, regimes = scene(0)
    before = np.random.default_rng(0).normal(size=(len(segments) * 60, 1))
    before[segments[7].first : segments[7].last] += 20.0
    place = locate(CHANNELS[:1], segments, regimes, before, None, np.ones(1))[0]
    assert "in run run_7 alone" in place.regime
    assert place.share > 0.9


def test_masked_blocks_count_for_nothing():
    segments, regimes = scene(0)
    before = np.random.default_rng(0).normal(size=(len(segments) * 60, 2))
    before[::3] = np.nan
    before[:, 1] = np.nan
    quiet, nothing = sorted(
        locate(CHANNELS, segments, regimes, before, before, np.ones(2)), key=lambda p: p.channel
    )
    assert quiet.regime == QUIET
    assert nothing.regime == "nothing measured"


def test_the_same_mismatch_gives_the_same_places():
    signal = CAUSES["speed above"][0]
    assert _located(signal) == _located(signal)


def test_flags_of_floors_read_as_the_floor():
    segments, regimes = scene(0, floors=("natural_stone", "pvc"), lateral=(0.0,))
    floor = regimes.pop("floor")[1]
    for name in ("natural_stone", "pvc"):
        regimes[f"floor {name}"] = ("1", (floor == name).astype(float))
    before = mismatch(6.0 * (floor == "pvc"), segments)
    assert locate(CHANNELS, segments, regimes, before, None, NOISE)[0].regime.startswith(
        "on pvc and not on natural_stone"
    )


def test_a_single_short_piece_is_located_without_a_claim():
    segment = Segment("a", "a", 0, 6, np.arange(6.0))
    place = locate(
        (Channel("position", "m", "position"),),
        (segment,),
        {"speed": ("m/s", np.arange(6.0))},
        np.arange(6.0)[:, None],
        None,
        np.ones(1),
    )
    assert len(place) == 1
    assert place[0].regime.startswith("all of it")


@pytest.mark.parametrize(("low", "high"), [(0.1999, 0.3501), (-0.2, 0.2), (1.23456, 1.23457), (-7.1, -6.2)])
def test_a_cut_is_the_roundest_number_between_its_neighbours(low, high):
    number = round_between(low, high)
    assert low < number <= high
    assert len(f"{number:.10g}") <= 8
