"""Everything that the layout of a recording shows is in its data: complete, on time, and coloured."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnosed_runs import with_robust
from rerun.chunk import RrdReader
from test_rerun import ReadBack

from omnimj.signals import Trace
from omnimj.view.rerun.recording import write_recording

_VIEWS = ("ViewBlueprint:space_origin", "ViewContents:query")
_COLOURS = ("SeriesLines:colors", "StateConfiguration:colors", "Mesh3D:vertex_colors", "Mesh3D:albedo_factor")
_FRAMING = "/world/machine/chassis/around"
"""An invisible point, for the camera to keep a distance."""
_COLOURS += ("Boxes3D:colors", "LineStrips3D:colors", "Arrows3D:colors", "Points3D:colors")


@pytest.fixture(scope="module")
def back(tmp_path_factory, robot_trace, robot_scenario, robot_metrics, robot_poses) -> ReadBack:
    path = tmp_path_factory.mktemp("layout") / "run.rrd"
    metrics = {**robot_metrics, "method": "robust"}
    trace = with_robust(robot_trace)
    recovery = np.where(trace["mode"] == 2.0, 1.0, 0.0)  # none, then a recovery mode while a fault is known
    trace = Trace({**trace.columns, "recovery": recovery}, trace.about)
    write_recording(path, trace, robot_scenario, metrics, robot_poses)
    return ReadBack(path)


def shown(path: Path) -> set[str]:
    """Entities that the views of a recording's blueprint name."""
    reader, origins, queries = RrdReader(path), {}, {}
    for chunk in reader.stream(store=reader.blueprints()[0]).to_chunks():
        batch = chunk.to_record_batch()
        for name, found in zip(_VIEWS, (origins, queries), strict=True):
            if name in batch.schema.names:
                found[chunk.entity_path.removesuffix("/ViewContents")] = batch.column(name).to_pylist()[-1]
    texts = [
        text.replace("$origin", f"/{origins[view][0].strip('/')}")
        for view, query in queries.items()
        for text in query
    ]
    return {text for text in texts if not text.startswith("-")}


def components(back: ReadBack) -> dict[tuple[str, str], list[Any]]:
    """Values of every component by entity and name, nulls left out."""
    found: dict[tuple[str, str], list[Any]] = {}
    for chunk in back.chunks:
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if ":" in name:
                values = [v for v in batch.column(name).to_pylist() if v is not None]
                found.setdefault((chunk.entity_path, name), []).extend(values)
    return found


@pytest.fixture(scope="module")
def parts(back) -> Mapping[tuple[str, str], list[Any]]:
    return components(back)


def flat(values: Any) -> np.ndarray:
    """All numbers of nested lists."""
    if isinstance(values, list | tuple):
        return np.concatenate([flat(one) for one in values] or [np.empty(0)])
    return np.array([values], float)


@pytest.mark.slow
def test_every_view_of_the_layout_has_an_entity_with_data(back, parts):
    views, filled = shown(back.reader.path), {entity for (entity, _), v in parts.items() if v}
    assert len(views) > 10
    for query in views:
        below = query.removesuffix("/**")
        assert any(e == below or e.startswith(f"{below}/") for e in filled), query


def test_every_entity_is_in_some_view_but_lanes_without_an_event(back, parts):
    views = shown(back.reader.path)
    quiet = {e for (e, name), rows in parts.items() if name == "StateChange:state" and rows == [["healthy"]]}
    below = tuple(f"{query.removesuffix('**')}" for query in views if query.endswith("/**"))
    for entity in back.entities - quiet - {"/__properties"}:
        assert entity in views or f"{entity}/".startswith(below), entity


def test_times_increase_and_stay_within_the_run(back, robot_trace):
    moving = {chunk.entity_path for chunk in back.chunks if not chunk.is_static}
    assert len(moving) > 20
    for entity in moving:
        time = back.time(entity)
        assert np.all(np.diff(time) > 0.0) and time[0] >= 0.0, entity
        assert time[-1] <= robot_trace["time"][-1] + 1e-9, entity
    for entity in (e for e in moving if e.startswith(("/plots/", "/world/machine/", "/world/forces/"))):
        time = back.time(entity)
        assert time[0] == 0.0 and time[-1] == pytest.approx(robot_trace["time"][-1]), entity


def test_no_position_rotation_or_signal_is_missing(parts):
    names = ("Transform3D:", "InstancePoses3D:", "Scalars:", "LineStrips3D:strips", "Arrows3D:")
    names += ("Mesh3D:vertex_positions", "Mesh3D:vertex_normals", "Boxes3D:", "Points3D:positions")
    found = {key: v for key, v in parts.items() if key[1].startswith(names)}
    assert len(found) > 40
    for key, values in found.items():
        numbers = flat(values)
        assert len(numbers) and np.isfinite(numbers).all(), key


def test_every_colour_is_visible_and_every_line_has_one(back, parts):
    coloured = {key: flat(values) for key, values in parts.items() if key[1] in _COLOURS}
    del coloured[_FRAMING, "Points3D:colors"]
    assert len(coloured) > 20
    for key, values in coloured.items():
        assert len(values) and np.isfinite(values).all(), key
        assert np.all(values.astype(np.uint32) & 0xFF > 0), key  # not transparent
    for entity in (e for e in back.entities if e.startswith("/plots/")):
        lines = len(parts[entity, "Scalars:scalars"][0])
        for name in ("colors", "names", "widths"):
            assert len(parts[entity, f"SeriesLines:{name}"][-1]) == lines, entity


def test_every_state_that_occurs_has_a_name_and_a_colour(parts):
    lanes = [entity for entity, name in parts if name == "StateChange:state"]
    assert len(lanes) > 6
    for lane in lanes:
        known = parts[lane, "StateConfiguration:values"][-1]
        occurring = {state for row in parts[lane, "StateChange:state"] for state in row}
        assert occurring <= set(known), lane
        for name in ("colors", "labels"):
            assert len(parts[lane, f"StateConfiguration:{name}"][-1]) == len(known), lane
