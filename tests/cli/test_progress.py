"""Progress of long work: time left, lines in a pipe, silence on demand, and the log."""

from __future__ import annotations

import io
import logging
import re
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnimj.cli import progress
from omnimj.cli.main import main, make_parser
from omnimj.cli.progress import ProgressBar, progress_bar


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def drive(stream, duration, steps, phase=""):
    """Show steady work of a duration [s]."""
    clock = Clock()
    with ProgressBar(stream, clock) as bar:
        for k in range(steps + 1):
            clock.now = duration * k / steps
            bar.show(k, steps, phase)
    return stream.getvalue()


@given(st.floats(10.0, 20_000.0))
def test_the_time_left_of_steady_work_is_what_it_still_takes(duration):
    text = drive(Terminal(), duration, 100)
    for percent, left in re.findall(r"(\d+) %  ([\d:]+) left", text):
        seconds = 0
        for part in left.split(":"):
            seconds = 60 * seconds + int(part)
        assert seconds == pytest.approx(duration * (1.0 - int(percent) / 100.0), abs=1.0)
    assert len(re.findall("left", text)) > 50


def test_a_pipe_gets_a_line_per_tenth_of_long_work_and_nothing_of_short_work():
    lines = drive(io.StringIO(), 200.0, 1000, "fitting").splitlines()
    assert [re.findall(r"(\d+) %", line)[0] for line in lines] == [str(10 * k) for k in range(1, 11)]
    assert lines[4] == "omnimj: 50 %, fitting, 1:40 left"
    assert drive(io.StringIO(), 4.9, 1000) == ""


def test_a_pipe_gets_at_most_a_line_in_five_seconds_however_many_phases_there_are():
    stream, clock = io.StringIO(), Clock()
    with ProgressBar(stream, clock) as bar:
        for k in range(10_000):
            clock.now = 0.01 * k
            bar.show(k % 10, 10, f"phase {k // 10}")
    assert len(stream.getvalue().splitlines()) == 19


def test_a_line_of_the_bar_fits_on_a_terminal():
    text = drive(Terminal(), 30_000.0, 1000, "a phase with a name that is much longer than a line")
    assert max(len(re.sub("\x1b.K", "", line)) for line in text.split("\r")) <= 80


def test_quiet_work_shows_nothing(monkeypatch):
    stream = Terminal()
    monkeypatch.setattr("sys.stderr", stream)
    for quiet in (True, False):
        arguments = make_parser().parse_args(["scenarios", *(["-q"] if quiet else [])])
        with progress_bar(arguments) as bar:
            bar.show(1, 2)
        assert bool(stream.getvalue()) != quiet


@pytest.mark.parametrize("quiet", [False, True])
def test_a_terminal_sees_a_sign_of_life_before_there_is_anything_else(monkeypatch, quiet):
    stream = Terminal()
    monkeypatch.setattr("sys.stderr", stream)
    monkeypatch.setattr(progress, "_NOTICE_AFTER", 0.0)
    arguments = make_parser().parse_args(["scenarios", *(["-q"] if quiet else [])])
    with progress.start_notice(arguments):
        until = time.monotonic() + 10.0
        while not quiet and not stream.getvalue() and time.monotonic() < until:
            pass
    assert stream.getvalue() == ("" if quiet else "loading …\n")


def test_the_log_tells_command_files_and_exit_code_and_is_appended_to(tmp_path, capsys):
    log, out = tmp_path / "omnimj.log", tmp_path / "dataset"
    logs = tmp_path / "log.csv"
    logs.write_text("time,current_1\n" + "".join(f"{0.01 * k},{k % 7}\n" for k in range(300)))
    for _ in range(2):
        main(["import", str(logs), "--mapping", str(tmp_path / "m.toml"), "--force", "--log", str(log)])
    text = log.read_text()
    assert text.count(f"omnimj import {logs}") == 2 and "wrote" in text and "exit code" in text
    assert not out.exists() and "omnimj.cli" not in capsys.readouterr().err
    assert logging.getLogger("omnimj").handlers == []


def test_verbose_writes_the_log_to_stderr_and_errors_keep_their_traceback_in_the_log(tmp_path, capsys):
    log = tmp_path / "omnimj.log"
    assert main(["compare", str(tmp_path / "none"), "-v", "--log", str(log)]) == 2
    printed = capsys.readouterr().err
    assert "INFO omnimj.cli.main: omnimj" in printed and printed.splitlines()[-1].startswith("omnimj: ")
    assert "Traceback" in log.read_text() and "InputError" in log.read_text()


def test_a_log_that_cannot_be_written_ends_the_command_before_its_work(tmp_path, capsys):
    assert main(["scenarios", "--log", str(tmp_path / "none" / "log")]) == 1
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.count("\n") == 1 and "--log" in printed.err
