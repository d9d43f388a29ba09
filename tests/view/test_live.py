"""A run that is watched: what is streamed while it goes on and what is there at its end."""

from __future__ import annotations

import dataclasses
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from omnimj.errors import SimulationError
from omnimj.simulate.run import RunResult, run_scenario
from omnimj.simulate.scenario.scenario import read_scenario
from omnimj.view.rerun import viewer as viewer_room
from omnimj.view.rerun.live import LiveRun
from omnimj.view.rerun.viewer import LOOPBACK, Viewer, ViewerError, open_viewer

KNOWN = {"scenario": "made", "method": "off", "seed": 0}
SHORT = ("duration=0.75", "checks.tracking_error_max=9.0")


class File:
    """A destination that writes down what it is sent."""

    def __init__(self, path: Path):
        self.path, self.is_open, self.settled = path, True, False

    def connect(self, stream: rr.RecordingStream, blueprint: rr.blueprint.Blueprint) -> None:
        stream.save(self.path)
        stream.send_blueprint(blueprint)

    def settle(self) -> None:
        self.settled = True


def times(path: Path) -> dict[str, list[float]]:
    """Times of all rows by entity."""
    found: dict[str, list[float]] = {}
    for chunk in RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        rows = found.setdefault(chunk.entity_path, [])
        if not chunk.is_static:
            rows += [t.total_seconds() for t in batch.column("time").to_pylist()]
    return found


def ends(run: RunResult) -> float:
    """Time of the last pose."""
    assert run.poses is not None
    return float(run.poses.time[-1])


def watched(live: LiveRun, scenario, plant: str | None = None) -> RunResult:
    return run_scenario(scenario, plant, callbacks=live.callbacks)


@pytest.fixture(scope="module")
def nylon(tmp_path_factory) -> tuple[File, RunResult]:
    sink = File(tmp_path_factory.mktemp("live") / "live.rrd")
    scenario = read_scenario("nylon_patch", SHORT)
    live = LiveRun(scenario, KNOWN, sink)
    run = watched(live, scenario)
    live.finish(run)
    return sink, run


def test_every_pose_and_every_signal_of_a_watched_run_arrives_in_order_of_time(nylon):
    sink, run = nylon
    seen = times(sink.path)
    for entity in ("/world/machine/chassis", "/world/machine/wheel_2/rollers"):
        at = sorted(set(seen[entity]))
        np.testing.assert_allclose(at, run.poses.time, atol=1e-9)
        assert seen[entity] == sorted(seen[entity])
    for entity in ("/plots/wheel_speed", "/plots/current", "/plots/heading"):
        at = np.array(seen[entity])
        assert (at[0], at[-1]) == (run.trace["time"][0], pytest.approx(run.trace["time"][-1]))
        assert np.all(np.diff(at) > 0)
        assert np.max(np.diff(at)) < 0.0065
    assert seen["/world/path/driven"][-1] == pytest.approx(run.trace["time"][-1])


def test_a_watched_run_ends_with_its_faults_and_checks(nylon):
    sink, run = nylon
    chunks = RrdReader(sink.path).stream().to_chunks()
    words, states = [], []
    for chunk in chunks:
        batch = chunk.to_record_batch()
        if chunk.entity_path == "/about":
            words += [text for row in batch.column("TextDocument:text").to_pylist() for text in row]
        if chunk.entity_path == "/fault/wheel_1" and "StateChange:state" in batch.schema.names:
            states += [state for row in batch.column("StateChange:state").to_pylist() for state in row or ()]
    assert "peak slip 1" not in words[0] and "peak slip 1" in words[-1]
    assert run.metrics["faults"][0]["kind"] == "slip"
    assert "slip" in states
    assert sink.settled


def test_what_is_seen_before_the_first_step_is_the_machine_at_its_start(tmp_path):
    scenario = read_scenario("square_path", ("duration=1.0",))
    sink = File(tmp_path / "start.rrd")
    live = LiveRun(scenario, KNOWN, sink)

    def stop(plant) -> None:
        live.start(plant)
        raise SimulationError("no step is taken")

    with pytest.raises(SimulationError):
        run_scenario(scenario, callbacks=dataclasses.replace(live.callbacks, start=stop))
    live.close()
    seen = times(sink.path)
    assert seen["/world/machine/chassis"] == [0.0]
    assert {"/world/path/planned", "/world/floor/natural_stone", "/about", "/fault/wheel_4"} <= set(seen)
    for chunk in RrdReader(sink.path).stream().to_chunks():
        if chunk.entity_path == "/world/machine/chassis":
            batch = chunk.to_record_batch()
            if "Transform3D:translation" in batch.schema.names:
                (place,) = batch.column("Transform3D:translation").to_pylist()
                np.testing.assert_allclose(np.ravel(place)[:2], scenario.drive.reference.position[0])


@pytest.mark.parametrize(
    "name, method, entity",
    [
        ("nylon_patch", "robust", "/plots/residual_slip"),
        ("nylon_patch", "published", "/plots/residual_wheel_speed"),
        ("rig_slip", "published", "/plots/residual_wheel_speed"),
    ],
)
def test_a_watched_method_shows_its_residuals_while_it_drives(tmp_path, name, method, entity):
    scenario = read_scenario(name, ("duration=0.4",))
    sink = File(tmp_path / "method.rrd")
    live = LiveRun(scenario, {**KNOWN, "method": method}, sink)
    run = run_scenario(scenario, "planar", method, callbacks=live.callbacks)
    live.finish(run)
    seen = times(sink.path)
    assert seen[entity][-1] == pytest.approx(run.trace["time"][-1])
    assert np.all(np.diff(seen[entity]) > 0)
    assert {"/mode", "/diagnosis/wheel_1"} <= set(seen)


@pytest.mark.slow
@pytest.mark.parametrize("name, plant", [("circle_8m", "planar"), ("circle_8m_kinematic", None)])
def test_plants_without_poses_are_shown_with_the_robot_on_its_path(tmp_path, name, plant):
    scenario = read_scenario(name, () if plant is None else ("duration=0.6",))
    live = LiveRun(scenario, KNOWN, sink := File(tmp_path / "planar.rrd"))
    run = watched(live, scenario, plant)
    live.finish(run)
    seen = times(sink.path)
    assert seen["/world/machine/chassis"][-1] == pytest.approx(run.trace["time"][-1])
    assert seen["/plots/wheel_speed"][-1] == pytest.approx(run.trace["time"][-1])


def test_the_rig_is_shown_while_it_drives(tmp_path):
    scenario = read_scenario("rig_lateral", ("duration=0.3",))
    live = LiveRun(scenario, KNOWN, sink := File(tmp_path / "rig.rrd"))
    run = watched(live, scenario)
    live.finish(run)
    seen = times(sink.path)
    for entity in ("/world/machine/gantry", "/world/machine/carriage", "/world/machine/wheel_1"):
        np.testing.assert_allclose(sorted(set(seen[entity])), 0.02 * np.arange(16), atol=1e-9)
        assert seen[entity][-1] == pytest.approx(ends(run))


def test_a_viewer_that_is_closed_is_sent_nothing_more_and_the_run_goes_on(tmp_path):
    scenario = read_scenario("nylon_patch", SHORT)
    live = LiveRun(scenario, KNOWN, sink := File(tmp_path / "closed.rrd"))

    def rows(names, table):
        live.rows(names, table)
        sink.is_open = float(table[-1, 0]) < 0.35

    run = run_scenario(scenario, callbacks=dataclasses.replace(live.callbacks, rows=rows))
    live.finish(run)
    assert run.metrics["duration"] == 0.75
    assert times(sink.path)["/plots/current"][-1] == pytest.approx(0.399)


@pytest.fixture
def receiver(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Viewer, Path]]:
    """A viewer that needs no window, since it only writes down what it is sent."""
    monkeypatch.setenv("DISPLAY", ":no-such-display")
    path = tmp_path / "received.rrd"
    viewer = open_viewer(("--save", str(path)))
    yield viewer, path
    viewer.leave()
    os.killpg(viewer._process.pid, signal.SIGTERM)
    viewer._process.wait()


@pytest.mark.skipif(sys.platform != "linux", reason="all of 127.0.0.0/8 is this machine only there")
def test_a_viewer_listens_on_the_loopback_address_only(receiver):
    viewer, _ = receiver
    socket.create_connection((LOOPBACK, viewer._port), timeout=5.0).close()
    with pytest.raises(OSError):
        socket.create_connection(("127.0.0.2", viewer._port), timeout=5.0)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="process groups")
@pytest.mark.filterwarnings("ignore:RRD file has no footer")  # the receiver is stopped, not finished
def test_a_run_reaches_another_process_over_the_loopback_address(receiver):
    viewer, path = receiver
    scenario = read_scenario("nylon_patch", ("duration=0.3", "checks.tracking_error_max=9.0"))
    live = LiveRun(scenario, KNOWN, viewer)
    run = watched(live, scenario)
    live.finish(run)
    assert viewer.is_open
    last, received = ends(run), 0.0
    until = time.monotonic() + 20.0
    while received < last - 1e-6 and time.monotonic() < until:  # the receiver writes in its own time
        received = max(times(path).get("/world/machine/chassis", [0.0]), default=0.0)
    assert received == pytest.approx(last)


def test_a_viewer_that_ends_before_it_answers_is_reported_with_its_message(tmp_path):
    script = "import sys; print('Error: graphics: no adapter found\\nbye', file=sys.stderr); sys.exit(3)"
    with (tmp_path / "complaints").open("w+b") as complaints:
        process = subprocess.Popen([sys.executable, "-c", script], stderr=complaints)
        viewer = Viewer(process, viewer_room._free_port(), complaints)
        with pytest.raises(ViewerError, match=r"failed \(no adapter found\).*--out DIR"):
            viewer.await_server()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is always a display")
def test_a_display_that_does_not_exist_is_reported_before_anything_is_driven(monkeypatch):
    monkeypatch.setenv("DISPLAY", ":no-such-display")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(ViewerError, match=r"^--view: the Rerun viewer failed \(.+\); use --out DIR"):
        open_viewer()


def test_a_viewer_that_breaks_down_later_is_reported_at_the_end(tmp_path):
    with (tmp_path / "complaints").open("w+b") as complaints:
        process = subprocess.Popen(
            [sys.executable, "-c", "import sys; sys.exit('Error: out of memory')"], stderr=complaints
        )
        viewer = Viewer(process, viewer_room._free_port(), complaints)
        process.wait()
        assert not viewer.is_open
        with pytest.raises(ViewerError, match="out of memory"):
            viewer.settle()


def test_a_viewer_whose_window_was_closed_is_no_error(tmp_path):
    with (tmp_path / "complaints").open("w+b") as complaints:
        process = subprocess.Popen([sys.executable, "-c", ""], stderr=complaints)
        viewer = Viewer(process, viewer_room._free_port(), complaints)
        process.wait()
        viewer.settle()


def test_without_a_display_the_viewer_explains_what_to_do(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    with pytest.raises(ViewerError, match=r"no display .* run `rerun run\.rrd`"):
        open_viewer()


def test_a_free_port_can_be_listened_on():
    with socket.socket() as listener:
        listener.bind((LOOPBACK, viewer_room._free_port()))
