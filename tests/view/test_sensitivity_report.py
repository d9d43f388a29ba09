"""Report and pictures of a study of sensitivity, from numbers that are known."""

from __future__ import annotations

import html
import re
from pathlib import Path

import numpy as np
import pytest

from omnimj.studies.sensitivity.elementary_effects import bootstrap_mu_star, effect_statistics
from omnimj.studies.sensitivity.factors import ExcludedFactor, Factor
from omnimj.studies.sensitivity.ranking import ResultSensitivity, rank_all
from omnimj.studies.sensitivity.study import SensitivityConfig, SensitivityResult
from omnimj.studies.sensitivity.trial import TrialConfig
from omnimj.view.plots.sensitivity import measure_first_picture, result_bars, result_plane, rows_shown
from omnimj.view.report.sensitivity import write_sensitivity_files

VARIED = tuple(Factor(f"motor.<{name}>", "N", 2.0, 1.0, 3.0) for name in ("strong", "weak", "idle", "wild"))
SIZES = np.array([4.0, 1.0, 0.0, 0.5])


def study_of(name: str, unit: str, floor: float) -> ResultSensitivity:
    random = np.random.default_rng(1)
    effects = random.uniform(0.9, 1.1, (8, 4)) * SIZES
    effects[1:, 3] = 0.0  # one trajectory alone
    draws = bootstrap_mu_star(effects, 1)
    return ResultSensitivity(name, unit, 1.0, floor, floor, effect_statistics(effects, draws), draws)


def outcome_of(*studies: ResultSensitivity, **more) -> SensitivityResult:
    return SensitivityResult(
        scenario="made_up",
        description="A scenario & its numbers",
        plant="planar",
        method="off",
        config=SensitivityConfig(Path("out"), TrialConfig("made_up"), 8),
        factors=VARIED,
        excluded=(ExcludedFactor("bearing.<dry>", "it is 0"),),
        studies=studies,
        ranks=rank_all(studies),
        **{"runs": 40, "repeats": 20, "errors": {}, "interrupted": False, **more},
    )


def page_of(folder: Path) -> str:
    return (folder / "report.html").read_text(encoding="utf-8")


def test_the_report_names_what_to_measure_first_and_what_not(tmp_path):
    write_sensitivity_files(tmp_path, outcome_of(study_of("speed", "m/s", 0.0), study_of("place", "m", 2.0)))
    page = page_of(tmp_path)
    assert "motor.&lt;strong&gt;" in page and "<strong>" not in page, "names from files are made safe"
    told = html.unescape(page)
    assert "Measure first: motor.<strong>" in told
    assert "No effect at all (1): motor.<idle>" in told
    assert "Uncertain; more trajectories are needed (1): motor.<wild>" in told
    assert "Not distinguishable from noise (2): motor.<weak>, motor.<wild>" in told
    assert "bearing.<dry>: it is 0" in told
    assert page.count("<svg") == 3  # a result with one ranked number needs no picture of its own
    assert not re.search(r"https?://", page)
    assert (tmp_path / "sensitivity.png").read_bytes().startswith(b"\x89PNG")
    assert "| 1 | motor.<strong> |" in (tmp_path / "sensitivity.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("studies", [(), (study_of("speed", "m/s", 100.0),)], ids=["no runs", "all noise"])
def test_where_nothing_is_ranked_the_report_states_it_and_an_old_picture_is_removed(tmp_path, studies):
    (tmp_path / "sensitivity.png").touch()
    write_sensitivity_files(tmp_path, outcome_of(*studies, runs=0, interrupted=True))
    assert "No parameter is distinguishable from noise with certainty." in page_of(tmp_path)
    assert "the same command continues from here" in page_of(tmp_path)
    assert not (tmp_path / "sensitivity.png").exists()


def test_the_picture_has_a_row_per_number_that_is_worth_half_a_percent():
    studies = [study_of("speed", "m/s", 0.0), study_of("count", "", 0.0)]
    ranks = rank_all(studies)
    figure = measure_first_picture(ranks, studies, VARIED)
    left, right = figure.axes
    assert rows_shown(ranks) == 3 and len(left.patches) == 3
    assert [rank.sure for rank in ranks] == [True, True, False]
    assert [patch.get_width() for patch in left.patches] == pytest.approx([100 * r.share for r in ranks])
    shown = np.asarray(right.images[0].get_array())
    expected = 100.0 * SIZES / (SIZES[:2].sum() + SIZES[3] / 8.0)  # the wild one acts in one of eight
    assert shown.tolist() == [pytest.approx([value] * 2, rel=0.05) for value in expected[[0, 1]]] + [
        pytest.approx([100.0 * SIZES[3] / 8.0 / 5.06] * 2, rel=0.15)
    ]


def test_bars_and_plane_show_the_ranked_numbers_and_the_floor():
    study = study_of("speed", "m/s", 0.5)
    bars, plane = result_bars(study, VARIED).axes[0], result_plane(study).axes[0]
    assert [patch.get_width() for patch in bars.patches] == pytest.approx([4.0, 1.0], rel=0.1)
    assert [label.get_text() for label in bars.get_yticklabels()] == ["1  motor.<strong>", "2  motor.<weak>"]
    for ax in (bars, plane):
        assert any(np.array_equal(line.get_xdata(), [0.5, 0.5]) for line in ax.lines)
    assert {text.get_text() for text in plane.texts} >= {"1", "2", "noise"}
