"""A report on a diagnosis: truth beside diagnosis, residuals with thresholds, nothing for `off`."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from diagnosed_runs import diagnosis_record, with_published, with_published_rig, with_robust
from drawn import bars, lines, row_names

from omnimj.control.detection.detector import DetectorOptions
from omnimj.control.detection.published import rig, robot
from omnimj.control.detection.robust import judgement as robust
from omnimj.signals import KINDS_OF_DIAGNOSIS, Trace
from omnimj.simulate.detectors import METHODS, make_detector
from omnimj.simulate.scenario.scenario import read_scenario
from omnimj.view import palette, wording
from omnimj.view.comparison import compare
from omnimj.view.plots import diagnosis as plots_diagnosis
from omnimj.view.report.run import write_report
from omnimj.view.report.run_diagnosis import diagnosis_section
from omnimj.view.residuals import families
from omnimj.view.wording import Span, diagnosis_spans, fault_spans, mode_name


def section_text(trace, scenario, metrics) -> str:
    """The verdict and the cells of the section."""
    section = diagnosis_section(trace, scenario, metrics, fault_spans(metrics, 10.0))
    rows = [] if section.table is None else section.table.rows
    return " ".join([section.verdict, *(str(cell.text) for row in rows for cell in row if cell.text)])


def test_truth_and_diagnosis_stand_in_one_row(robot_trace, robot_scenario, robot_metrics, undrawn):
    page = section_text(with_robust(robot_trace), robot_scenario, robot_metrics)
    assert "slip, wheel 2 (floor nylon) 3 s – 5 s slip, wheel 2 3.100 s 0.1 s 97 % nothing 5.050 s" in page
    weak = (
        "motor loss, wheel 3 (loss 57 %) 6.5 s – end motor loss, wheel 3 6.900 s 0.4 s 90 % slip not cleared"
    )
    assert weak in page
    assert "First alarm 0.1 s after the first onset. 2 of 2 faults were diagnosed" in page


def test_a_false_alarm_has_its_row_with_its_number_of_times(
    robot_trace, robot_scenario, robot_metrics, undrawn
):
    wrong = [diagnosis_record(8.0, "slip", 4, cleared=8.1), diagnosis_record(8.5, "slip", 4, cleared=8.6)]
    metrics = {**robot_metrics, "diagnoses": [*robot_metrics["diagnoses"], *wrong], "isolated": False}
    page = section_text(with_robust(robot_trace), robot_scenario, metrics)
    assert "– slip, wheel 4 (2 times) 8.000 s false alarm 98 % nothing 8.600 s" in page
    assert "2 of 2 faults were diagnosed but not isolated. 2 false alarms." in page


@pytest.mark.slow
@pytest.mark.parametrize(
    ("faults", "diagnoses", "expected"),
    [
        ([], [], "no fault that the method can diagnose, and nothing was diagnosed."),
        ([], [diagnosis_record(1.0, "slip", 1)], "but 1 false alarm."),
        ([{"kind": "motor", "wheel": 1, "onset": 1.0, "end": None}], [], "A fault held, and nothing was"),
        (
            [{"kind": "payload", "wheel": None, "onset": 0.0, "end": None}],
            [],
            "outside the method's fault classes",
        ),
    ],
)
def test_nothing_found_and_nothing_wrong_are_stated(
    robot_trace, robot_scenario, robot_metrics, faults, diagnoses, expected, undrawn
):
    metrics = {**robot_metrics, "faults": faults, "diagnoses": diagnoses, "isolated": None}
    assert expected in section_text(with_robust(robot_trace), robot_scenario, metrics)


def test_a_run_without_a_method_has_no_such_section(
    page_path, robot_path, robot_scenario, robot_metrics, undrawn
):
    metrics = {**robot_metrics, "method": "off", "diagnoses": []}
    write_report(page_path, robot_path, robot_scenario, metrics)
    page = page_path.read_text(encoding="utf-8")
    assert "Diagnosis" not in page and "Faults injected into the plant" in page


def test_every_residual_of_every_method_is_in_a_family_with_a_description():
    for name, scenario in (
        ("nylon_patch", "robust"),
        ("nylon_patch", "published"),
        ("rig_slip", "published"),
    ):
        method = make_detector(scenario, read_scenario(name))
        assert method is not None
        found = families(method.log_names, scenario)
        shown = [r.column for family in found for r in family.residuals]
        assert shown == [column for column in method.log_names if column.startswith("residual_")]
        thresholds = {column for family in found for column in family.thresholds}
        assert thresholds == {column for column in method.log_names if column.startswith("threshold_")}
        assert all(family.unit and not family.heading.startswith("Residual:") for family in found)


def test_a_residual_without_a_description_is_shown_under_its_name():
    (family,) = families(("residual_grip_1", "threshold_grip_1"), "robust")
    assert (family.heading, family.label) == ("Residual: grip", "grip")
    assert family.thresholds == ("threshold_grip_1",)


def family_panel(trace, family):
    """Plot of one family of residuals."""
    (panel,) = plots_diagnosis.residual_families(trace, [family], ()).panels
    return panel


def strips(*arguments):
    """Plot of true faults, diagnoses and modes."""
    (panel,) = plots_diagnosis.state_lanes(*arguments).panels
    return panel


def test_residuals_have_their_wheels_colours_and_one_threshold_line(robot_trace):
    trace = with_robust(robot_trace)
    found = {family.name: family for family in families(list(trace.columns), "robust")}
    assert set(found) == {"force", "moment", "motor", "slip"}
    panel = family_panel(trace, found["motor"])
    colors = {line.label: line.color for line in lines(panel)}
    assert all(colors[f"wheel {i}"] == palette.wheel_color(i - 1) for i in (1, 2, 3, 4))
    (threshold,) = lines(panel, "threshold")
    assert set(threshold.y) == {22.0}


def test_thresholds_of_both_signs_are_drawn_unless_the_method_looks_above_zero_only(robot_trace):
    trace = with_published(robot_trace)
    for printed, expected in ((False, {1.85, -1.85}), (True, {1.85})):
        family = families(list(trace.columns), "published", printed)[0]
        drawn = lines(family_panel(trace, family), "threshold")
        assert {round(float(line.y[0]), 6) for line in drawn} == expected


def test_thresholds_that_differ_are_drawn_each_in_its_wheels_colour(robot_trace):
    trace = with_robust(robot_trace)
    columns = {**trace.columns, "threshold_motor_2": 2.0 * trace["threshold_motor_2"]}
    family = families(list(columns), "robust")[2]
    drawn = lines(family_panel(dataclasses.replace(trace, columns=columns), family), "threshold")
    assert [line.color for line in drawn] == [palette.wheel_color(0), palette.wheel_color(1)]


def test_the_rigs_residuals_are_never_negative_and_have_no_threshold_below_zero(rig_trace):
    trace = with_published_rig(rig_trace)
    for family in families(list(trace.columns), "published"):
        (threshold,) = lines(family_panel(trace, family), "threshold")
        assert threshold.y[0] > 0.0 and "RMS" in family.words


def test_a_small_threshold_can_be_read_beside_a_large_residual(robot_trace):
    trace = with_robust(robot_trace)
    slip = next(family for family in families(list(trace.columns), "robust") if family.name == "slip")
    panel = family_panel(trace, slip)
    (threshold,) = lines(panel, "threshold")
    low, high = panel.plot.y_range.start, panel.plot.y_range.end
    assert 0.1 < (threshold.y[0] - low) / (high - low) < 0.6
    assert "logarithmic" in panel.y_axis.axis_label
    # the marks on the axis are where the same values are drawn
    ticks = {name: place for place, name in panel.y_axis.major_label_overrides.items()}
    peak = max(float(line.y.max()) for line in lines(panel, "wheel 2"))
    assert ticks["0.01"] < peak < ticks["0.1"] and ticks["0"] == 0
    # the values below the cursor are the residuals themselves
    data = panel.plot.renderers[0].data_source.data
    (hover,) = [tool for tool in panel.plot.toolbar.tools if tool.kind == "HoverTool"]
    column = dict(hover.tooltips)["wheel 2"].removeprefix("@").partition("{")[0]
    assert data[column].max() == np.float32(trace["residual_slip_2"].max())


def test_modes_and_faults_are_strips_at_their_times(robot_trace, robot_metrics):
    trace = with_robust(robot_trace)
    truth, believed = fault_spans(robot_metrics, 10.0), diagnosis_spans(robot_metrics, 10.0)
    panel = strips(trace, truth, believed, "robust", False)
    names = row_names(panel)
    assert names == ["true: wheel 2", "true: wheel 3", "diagnosed: wheel 2", "diagnosed: wheel 3", "mode"]
    found = {name: sorted(bar[1:3] for bar in bars(panel) if bar.row == name) for name in names}
    np.testing.assert_allclose(found["true: wheel 2"], [(3.0, 5.0)])
    np.testing.assert_allclose(found["diagnosed: wheel 3"], [(6.9, 10.0)])
    np.testing.assert_allclose(np.ravel(found["mode"])[::2], [0.0, 0.5, 3.1, 5.05, 6.8, 6.9], atol=2e-3)
    assert len(panel.labels) > 1


def test_a_mode_that_flickers_makes_few_bars_and_loses_no_short_event(robot_trace):
    mode = np.where(np.arange(len(robot_trace["time"])) % 2 == 0, 2.0, 0.0)
    mode[5000:8000] = 0.0
    mode[6500] = 1.0
    trace = Trace({**robot_trace.columns, "mode": mode})
    drawn = bars(strips(trace, [], [], "robust", False))
    assert len(drawn) <= 400
    suspect = [bar for bar in drawn if bar.color == palette.STATES["suspect"]]
    assert len(suspect) == 1 and suspect[0].left == pytest.approx(6.5, abs=0.03)


def test_diagnosed_faults_that_overlap_have_separate_strips(robot_trace):
    spans = [
        Span("", "robot", state, 2.0, end)
        for state, end in (("sensor yaw rate", 9.0), ("all wheels slip", 3.0))
    ]
    names = row_names(strips(with_robust(robot_trace), [], spans, "robust", False))
    assert names == ["true: nothing", "diagnosed: robot", "diagnosed: robot", "mode"]


def test_empty_strips_are_marked_as_empty(robot_trace):
    names = row_names(strips(with_robust(robot_trace), [], [], "robust", False))
    assert names[:2] == ["true: nothing", "diagnosed: nothing"]


def test_a_diagnosis_of_one_step_can_still_be_seen(robot_trace):
    one = [Span("slip, wheel 1", "wheel_1", "slip", 2.0, 2.0)]
    drawn = bars(strips(with_robust(robot_trace), [], one, "robust", False))
    assert any(bar.left == 2.0 and bar.right - bar.left >= 0.03 for bar in drawn)


def test_mode_names_are_those_of_the_methods():
    named = {
        mode: mode_name("robust", False, mode)
        for mode in (robust.HEALTHY, robust.SUSPECT, robust.FAULTY, robust.BLIND)
    }
    assert named == {0: "healthy", 1: "suspect", 2: "faulty", 3: "cannot judge"}
    assert mode_name("published", False, robot.SLIPPING) == "slip"
    assert mode_name("published", False, robot.ESTIMATING) == "torque constant is estimated"
    assert [mode_name("published", True, mode) for mode in rig._MODES.values()] == [
        "no fault",
        "slip",
        "motor fault",
    ]
    assert mode_name("robust", False, 17) == "mode 17"


def test_every_state_that_has_a_name_has_a_colour_of_its_own():
    kinds = [wording.FAULT_NAMES[kind] for kind in KINDS_OF_DIAGNOSIS if kind != "sensor"]
    assert set(kinds) <= set(palette.STATES)
    assert len({palette.state_color(kind) for kind in kinds}) == len(kinds)
    for names in wording.DETECTOR_MODE_NAMES.values():
        assert set(names) <= set(palette.STATES)
        assert len({palette.state_color(name) for name in names}) == len(names)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["robust", "published"])
def test_a_diagnosed_robots_report_has_all_its_figures(
    page_path, robot_trace, robot_scenario, robot_metrics, method, undrawn
):
    trace = {"robust": with_robust, "published": with_published}[method](robot_trace)
    write_report(page_path, trace, robot_scenario, {**robot_metrics, "method": method})
    page = page_path.read_text(encoding="utf-8")
    assert page.count("class='plot'") == 8 + {"robust": 6, "published": 4}[method]
    assert "Diagnosis" in page and "Truth and diagnosis" in page and "Effectiveness" in page


def test_a_diagnosed_rigs_report_has_its_figures(page_path, rig_trace, rig_scenario, rig_metrics, undrawn):
    truth = [{"kind": "motor", "wheel": 1, "onset": 0.0, "end": None}]
    metrics = {
        **rig_metrics,
        "method": "published",
        "faults": truth,
        "diagnoses": [diagnosis_record(0.5, "motor", 1)],
    }
    scenario = dataclasses.replace(rig_scenario, diagnosis=DetectorOptions("printed"))
    write_report(page_path, with_published_rig(rig_trace), scenario, metrics)
    page = page_path.read_text(encoding="utf-8")
    assert page.count("class='plot'") == 6 + 3
    assert "Effectiveness" not in page and "Two ways to compute the force" in page


@pytest.mark.slow
def test_runs_with_other_methods_stand_side_by_side(
    page_path, robot_trace, robot_scenario, robot_metrics, undrawn
):
    other = {**robot_metrics, "method": "off", "diagnoses": [], "max_yaw_excursion": 0.05, "isolated": False}
    metrics = {**robot_metrics, "compared": {"off": other}}
    comparison = compare(robot_scenario.metric_units, metrics)
    rows = {name: values for name, *values in comparison.rows}
    assert comparison.names == ("robust", "off")
    assert rows["checks passed"] == ["1 of 2", "1 of 2"]
    assert rows["every fault isolated"] == ["yes", "–"]
    assert rows["first alarm after onset"] == ["0.1 s", "–"]
    assert rows["max yaw excursion"] == ["0.0211 rad (1.21°)", "0.05 rad (2.86°)"]
    assert "path error rms" in rows
    write_report(page_path, robot_trace, robot_scenario, metrics, None, {"off": robot_trace})
    page = page_path.read_text(encoding="utf-8")
    for expected in ("Comparison of methods", "Courses", "Paths", "trace_off.parquet"):
        assert expected in page
    assert page.count("class='plot'") == 9 + 2


def test_every_method_has_a_colour():
    assert set(palette.METHODS) == set(METHODS)
    assert len({color for color, *_ in palette.METHODS.values()}) == len(METHODS)
