"""What the tests of the command line share."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from omnimj.cli.main import main
from omnimj.plant.planar import PlanarRobot
from omnimj.plant.planar_rig import PlanarRig
from omnimj.view.picture import picture_of_run


@pytest.fixture
def refused(capsys, monkeypatch, tmp_path):
    """Calls the command in an empty folder; returns its one line."""
    empty = tmp_path / "empty"
    empty.mkdir()
    monkeypatch.chdir(empty)

    def driven(self):
        raise AssertionError("driven")

    monkeypatch.setattr(PlanarRobot, "reset", driven)
    monkeypatch.setattr(PlanarRig, "reset", driven)

    def call(*argv: str, code: int = 2) -> str:
        returned = main(list(argv))
        out, err = capsys.readouterr()
        lines = [line for line in err.splitlines() if not line.startswith("compiling native code")]
        assert (returned, out, len(lines)) == (code, "", 1), (returned, out, err)
        assert lines[0].startswith("omnimj") and not lines[0].startswith("omnimj: omnimj")
        assert not list(empty.iterdir())
        return lines[0]

    return call


@pytest.fixture
def unrendered(monkeypatch):
    """Pictures of runs are asked for and not rendered, as on a machine without OpenGL: that takes seconds."""
    monkeypatch.setattr("omnimj.view.picture.picture_of_run", partial(picture_of_run, backends=()))


@pytest.fixture
def plain_files(monkeypatch):
    """Recording and report of a run are empty: they take seconds, and others test what is in them."""

    def touch(path: Path, *_: object) -> None:
        path.touch()

    monkeypatch.setattr("omnimj.view.report.run.write_report", touch)
    monkeypatch.setattr("omnimj.view.rerun.recording.write_recording_of", touch)
    monkeypatch.setattr("omnimj.cli.run._picture_of", lambda *_: None)
