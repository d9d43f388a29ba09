"""Report and pictures of a study of sensitivity, from numbers that are known."""

from __future__ import annotations

import html
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from drawn import bars, lines, marks, row_names, texts

from omnimj.studies.sensitivity.elementary_effects import (
    ResultSensitivity,
    bootstrap_mu_star,
    effect_statistics,
    rank_all,
)
from omnimj.studies.sensitivity.factors import ExcludedFactor, Factor
from omnimj.studies.sensitivity.study import SensitivityConfig, SensitivityResult
from omnimj.studies.sensitivity.trial import TrialConfig
from omnimj.view.plots.sensitivity import result_bars, result_plane, rows_shown, share_bars, share_matrix
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
    unescaped = html.unescape(page)
    assert "Measure first: motor.<strong>" in unescaped
    assert "No effect at all (1): motor.<idle>" in unescaped
    assert "Uncertain; more trajectories are needed (1): motor.<wild>" in unescaped
    assert "Not distinguishable from noise (2): motor.<weak>, motor.<wild>" in unescaped
    assert "bearing.<dry>: it is 0" in unescaped
    assert page.count("class='plot'") == 4  # a result with one ranked number needs no picture of its own
    assert not re.search(r"https?://", re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL))
    picture = ElementTree.fromstring((tmp_path / "sensitivity.svg").read_text(encoding="utf-8"))
    assert "motor.<strong>" in [text for element in picture.iter() for text in element.itertext()]
    assert "| 1 | motor.<strong> |" in (tmp_path / "sensitivity.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("studies", [(), (study_of("speed", "m/s", 100.0),)], ids=["no runs", "all noise"])
def test_where_nothing_is_ranked_the_report_states_it_and_an_old_picture_is_removed(tmp_path, studies):
    (tmp_path / "sensitivity.svg").touch()
    write_sensitivity_files(tmp_path, outcome_of(*studies, runs=0, interrupted=True))
    assert "No parameter is distinguishable from noise with certainty." in page_of(tmp_path)
    assert "the same command continues from here" in page_of(tmp_path)
    assert not (tmp_path / "sensitivity.svg").exists()


def test_the_shares_have_a_row_per_number_that_is_worth_half_a_percent():
    studies = [study_of("speed", "m/s", 0.0), study_of("count", "", 0.0)]
    ranks = rank_all(studies)
    ((left,), (right,)) = share_bars(ranks, VARIED).panels, share_matrix(ranks, studies, VARIED).panels
    drawn = bars(left)
    assert rows_shown(ranks) == 3 and [bar.row for bar in drawn] == row_names(left) == row_names(right)
    assert [rank.sure for rank in ranks] == [True, True, False]
    assert [bar.right - bar.left for bar in drawn] == pytest.approx([100 * rank.share for rank in ranks])
    expected = 100.0 * SIZES / (SIZES[:2].sum() + SIZES[3] / 8.0)  # the wild one acts in one of eight
    (cells,) = right.plot.renderers
    matches = [
        re.fullmatch(r"motor\.<(\w+)> in (\w+): (\S+) %", name) for name in cells.data_source.data["name"]
    ]
    names = [(row, column) for row in ("strong", "weak", "wild") for column in ("speed", "count")]
    assert [(one[1], one[2]) for one in matches if one] == names
    shown = np.reshape([float(one[3]) for one in matches if one], (3, 2))
    assert shown.tolist() == [pytest.approx([value] * 2, rel=0.05) for value in expected[[0, 1]]] + [
        pytest.approx([100.0 * SIZES[3] / 8.0 / 5.06] * 2, rel=0.15)
    ]
    words = {(label.y, label.x): label.text for label in marks(right, "Label")}
    assert [words[place] for place in sorted(words)] == [f"{share:.0f}" for share in shown.ravel()]
    depth = [int(color[1:3], 16) for color in cells.data_source.data["color"]]
    assert depth[0] < depth[2] < depth[4]  # the larger the share, the darker


def test_bars_and_plane_show_the_ranked_numbers_and_the_floor():
    study = study_of("speed", "m/s", 0.5)
    ((left,), (plane,)) = result_bars(study, VARIED).panels, result_plane(study, VARIED).panels
    assert [bar.right - bar.left for bar in bars(left)] == pytest.approx([4.0, 1.0], rel=0.1)
    assert row_names(left) == ["1  motor.<strong>", "2  motor.<weak>"]
    for panel in (left, plane):
        (floor,) = lines(panel, "noise")
        assert np.array_equal(floor.x, [0.5, 0.5])
    assert sorted(texts(plane)) == ["1", "2"]
