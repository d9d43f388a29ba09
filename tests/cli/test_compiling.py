"""The first run on a kind of plant announces that it compiles, before it does; no other run does."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from omnimj.cli.main import main
from omnimj.cli.terminal import announce_compilation, note_compiled
from omnimj.physics import native
from omnimj.plant.planar import PlanarRobot

LINE = "compiling native code for the planar plant, once"
QUICK = ("run", "nylon_patch", "--plant", "planar", "--set", "duration=0.05", "--set", "checks={}")


@pytest.fixture
def cache(monkeypatch, tmp_path) -> Path:
    """An empty cache; this process has compiled already, so that only the announcement is new."""
    folder = tmp_path / "cache"
    folder.mkdir()
    monkeypatch.setattr(native, "cache_folder", lambda package: folder)
    return folder


def test_every_kind_of_plant_is_announced_once(cache, capsys):
    for plant in ("twin", "planar"):
        for machine in ("uto_robot", "quarter_rig"):
            announce_compilation(plant, machine)
            printed = capsys.readouterr().err
            assert (
                printed.count("\n") == 1 and f"compiling native code for the {plant} plant, once" in printed
            )
            note_compiled(plant, machine)
            announce_compilation(plant, machine)
            assert capsys.readouterr().err == ""


def test_a_run_announces_it_and_the_next_does_not(cache, capsys):
    assert main(QUICK) == 0
    assert capsys.readouterr().err.startswith(LINE)
    assert main(QUICK) == 0
    assert capsys.readouterr().err == ""
    assert main((*QUICK, "--set", "floor=ice")) == 0
    assert capsys.readouterr().err == ""


def test_a_run_that_never_began_has_compiled_nothing(cache, capsys, monkeypatch):
    def interrupted(self, command):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(PlanarRobot, "step", interrupted)
        assert main(QUICK) == 130
    assert main(QUICK) == 0
    assert capsys.readouterr().err.count(LINE) == 2


def test_the_kinematic_level_compiles_too_little_for_a_notice(cache, capsys):
    assert main(["run", "circle_8m_kinematic"]) == 0
    assert capsys.readouterr().err == ""


def test_a_full_disk_does_not_end_a_run(cache, capsys, monkeypatch):
    def full(self, *_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "touch", full)
    assert main(QUICK) == 0


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["twin", "planar"])
def test_the_line_comes_before_the_imports_that_compile(tmp_path, plant):
    script = """
import sys
class Gate:
    def find_spec(self, name, path=None, target=None):
        if name in ("omnimj.plant.mujoco.twin", "omnimj.plant.planar"):
            print("now", name, file=sys.stderr)
            raise SystemExit(3)
sys.meta_path.insert(0, Gate())
from omnimj.cli.main import main
main(["run", "nylon_patch", "--plant", sys.argv[1]])
"""
    done = subprocess.run(
        [sys.executable, "-c", script, plant],
        capture_output=True,
        text=True,
        env={**os.environ, "OMNIMJ_CACHE": str(tmp_path)},
        check=False,
    )
    first, second = done.stderr.splitlines()
    assert done.returncode == 3 and second.startswith("now omnimj.")
    assert first.startswith(f"compiling native code for the {plant} plant, once")


def chosen_folder() -> Path:
    return native.cache_folder.__wrapped__("plant")


def test_the_cache_lies_where_it_may_be_written(monkeypatch, tmp_path):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("OMNIMJ_CACHE", str(tmp_path / "chosen"))
    assert chosen_folder().parent == tmp_path / "chosen"
    assert not list((tmp_path / "temporary").iterdir())
    monkeypatch.setenv("OMNIMJ_CACHE", str(tmp_path / "file"))
    assert chosen_folder().is_relative_to(tmp_path / "temporary")
    monkeypatch.delenv("OMNIMJ_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert chosen_folder().parent == tmp_path / "xdg" / "omnimj"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert chosen_folder().parent == tmp_path / "home" / ".cache" / "omnimj"


def test_an_account_without_a_home_has_a_cache(monkeypatch, tmp_path):
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    for name in ("OMNIMJ_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    assert chosen_folder().is_relative_to(tmp_path)


def test_a_temporary_folder_of_another_user_is_not_used(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / f"omnimj-{os.getuid() + 1}").mkdir()
    monkeypatch.setenv("OMNIMJ_CACHE", str(tmp_path / "file"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    assert chosen_folder().parent == tmp_path / f"omnimj-{os.getuid()}"
    theirs = os.getuid() + 1
    monkeypatch.setattr(os, "getuid", lambda: theirs)  # now the folder of that name belongs to another
    assert chosen_folder().name.startswith("omnimj-native-")  # made for this run alone


def test_an_edit_recompiles_the_kernels_of_its_package_and_of_those_above_only(monkeypatch, tmp_path):
    packages = native.KERNEL_PACKAGES
    for package in packages:
        (tmp_path / package).mkdir()
        (tmp_path / package / "a.py").write_text("@kernel\ndef f(): return 1\n")
    monkeypatch.setattr(native, "_PACKAGE", tmp_path)
    before = {package: native.fingerprint.__wrapped__(package) for package in packages}
    assert len(set(before.values())) == len(packages)
    (tmp_path / "control" / "a.py").write_text("@kernel\ndef f(): return 2\n")
    after = {package: native.fingerprint.__wrapped__(package) for package in packages}
    changed = {package for package in packages if before[package] != after[package]}
    assert changed == {"control", "simulate", "estimate", "learning"}
    (tmp_path / "physics" / "a.py").write_text("@kernel\ndef f(): return 2\n")
    assert all(native.fingerprint.__wrapped__(package) != after[package] for package in packages)
