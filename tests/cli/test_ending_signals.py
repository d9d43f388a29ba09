"""SIGTERM and SIGHUP end a command like Ctrl-C: what was finished is kept, and no process is left."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from omnimj.cli import main as main_module
from omnimj.cli.main import main
from omnimj.cli.terminal import ended_by_signals

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals are of POSIX")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_command_that_is_ended_returns_130_and_says_what_is_kept(number, monkeypatch, capsys):
    # who starts the tests by nohup has SIGHUP ignored, which a command would respect
    inherited = signal.signal(number, signal.SIG_DFL)
    listing = "omnimj.simulate.scenario.listing.list_scenarios"
    monkeypatch.setattr(listing, lambda: os.kill(os.getpid(), number))
    try:
        assert main(["scenarios"]) == 130
        assert signal.getsignal(number) is signal.SIG_DFL
    finally:
        signal.signal(number, inherited)
    words = "nothing was to be written; the same command begins again"
    assert capsys.readouterr().err == f"omnimj: interrupted; {words}\n"


@pytest.mark.parametrize(
    ("argv", "files", "words"),
    [
        (("gap", "data"), (), "nothing is in out yet; the same command begins again"),
        (
            ("gap", "data"),
            ("x",),
            "every file in out is complete; the same command with --force begins again",
        ),
        (("evaluate",), ("x",), "what was finished is kept, and the same command continues"),
        (("sensitivity", "circle_8m"), (), "what was finished is kept, and the same command continues"),
        (("tune", "circle_8m"), (), "what was finished is kept, and the same command continues"),
    ],
)
def test_what_is_kept_and_how_to_go_on_depends_on_the_command(
    argv, files, words, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)

    def interrupted(arguments):
        for name in files:
            (tmp_path / "out").mkdir()
            (tmp_path / "out" / name).touch()
        raise KeyboardInterrupt

    parsed = main_module.make_parser().parse_args([*argv, "--out", "out"])
    parsed.run = interrupted
    monkeypatch.setattr(main_module, "_parse", lambda parser, given: parsed)
    assert main([*argv, "--out", "out"]) == 130
    assert capsys.readouterr().err == f"omnimj: interrupted; {words}\n"


def test_a_signal_that_is_ignored_stays_ignored(monkeypatch):
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as under nohup
    try:
        with ended_by_signals():
            os.kill(os.getpid(), signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.slow
def test_a_study_that_is_ended_keeps_its_trials_and_leaves_no_process(tmp_path):
    script = "import sys; from omnimj.cli.main import main; sys.exit(main(sys.argv[1:]))"
    words = ("evaluate", "--trials", "400", "--workers", "2", "--out", str(tmp_path / "out"))
    study = subprocess.Popen(
        [sys.executable, "-c", script, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    cases = tmp_path / "out" / "cases"
    until = time.monotonic() + 300.0
    while not list(cases.glob("*.json")) and time.monotonic() < until:
        assert study.poll() is None
        time.sleep(0.2)
    study.terminate()
    printed, errors = study.communicate(timeout=120.0)
    assert study.returncode == 130 and b"the same command resumes it" in printed
    assert b"Traceback" not in errors and b"leaked" not in errors
    assert is_gone(study.pid) and Path(tmp_path / "out" / "evaluation.json").is_file()


def is_gone(group: int) -> bool:
    """Whether every process of a group ends within a few seconds."""
    until = time.monotonic() + 10.0
    while time.monotonic() < until:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(group, 0)
            time.sleep(0.1)
            continue
        return True
    return False
