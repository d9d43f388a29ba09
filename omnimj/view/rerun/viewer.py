"""A Rerun viewer in a process of its own."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from typing import IO

import rerun as rr
import rerun.blueprint as rrb

from omnimj.errors import OmnimjError

LOOPBACK = "127.0.0.1"
"""Rerun listens on all interfaces unless told otherwise; a run is nobody else's business."""
_PROGRAM = (
    "import sys; from rerun_cli.__main__ import main; sys.exit(main())"  # `-m rerun_cli` loses the exit code
)
_START_TIMEOUT = 30.0  # [s] for a viewer that starts on a slow machine
_OPENING = 0.6  # [s] a viewer whose display does not exist takes connections first and ends then
_SETTLING = 3.0  # [s] a viewer that lives longer has found its window
_POLL_INTERVAL = 0.02  # [s]
_ELSEWHERE = "use --out DIR instead, copy DIR/run.rrd to a computer with a display, run `rerun run.rrd` there"


class ViewerError(OmnimjError, RuntimeError):
    """No Rerun viewer could be opened, or it broke down."""


class Viewer:
    """A viewer that was started; it lives on when this process ends."""

    def __init__(self, process: subprocess.Popen[bytes], port: int, complaints: IO[bytes]):
        """A viewer's process, the port it listens on, and the file that it complains into."""
        self._process, self._port, self._complaints = process, port, complaints
        self._born = time.monotonic()

    @property
    def url(self) -> str:
        """Where it takes connections."""
        return f"rerun+http://{LOOPBACK}:{self._port}/proxy"

    @property
    def is_open(self) -> bool:
        """Whether it still runs."""
        return self._process.poll() is None

    def connect(self, stream: rr.RecordingStream, blueprint: rrb.Blueprint) -> None:
        """Sends all that is logged to a stream to this viewer, arranged by a blueprint."""
        stream.connect_grpc(self.url)
        stream.send_blueprint(blueprint)  # made active: the viewer may remember an older one of ours

    def await_server(self) -> None:
        """Waits until the viewer takes connections and has not ended over its display.

        Raises:
          ViewerError: It ended, or it does not answer; it is then ended.
        """
        answers = False
        while self.is_open and not (answers and time.monotonic() > self._born + _OPENING):
            if time.monotonic() > self._born + _START_TIMEOUT:
                self._process.terminate()
                break
            answers = answers or self._answers()
            time.sleep(_POLL_INTERVAL)
        if self.is_open and answers:
            return
        self._process.wait()
        try:
            self.check()
            raise ViewerError(f"--view: the Rerun viewer did not stay open; {_ELSEWHERE}")
        finally:
            self.leave()

    def _answers(self) -> bool:
        try:
            socket.create_connection((LOOPBACK, self._port), timeout=1.0).close()
        except OSError:
            return False
        return True

    def settle(self) -> None:
        """Waits until a viewer that finds no window would have ended, then leaves it to itself.

        Raises:
          ViewerError: It ended with an error; to close its window is none.
        """
        while self.is_open and time.monotonic() < self._born + _SETTLING:
            time.sleep(_POLL_INTERVAL)
        try:
            self.check()
        finally:
            self.leave()

    def leave(self) -> None:
        """Listens to no more complaints; the viewer lives on."""
        self._complaints.close()

    def check(self) -> None:
        """Says what a viewer that broke down complained about.

        Raises:
          ViewerError: It ended with an error.
        """
        if self._process.poll() in (None, 0):
            return
        self._complaints.seek(0)
        said = self._complaints.read().decode(errors="replace").splitlines()
        errors = [line for line in said if "error" in line.lower() or "panic" in line.lower()]
        reason = (
            errors[-1].rsplit(": ", 1)[-1].strip() if errors else f"exit status {self._process.returncode}"
        )
        raise ViewerError(f"--view: the Rerun viewer broke down ({reason}); {_ELSEWHERE}")


def open_viewer(arguments: Sequence[str] = ()) -> Viewer:
    """Opens a viewer whose server listens on the loopback address only, and waits until it does.

    Args:
      arguments: More options of the program `rerun`, as `--headless`.

    Raises:
      ViewerError: There is no display, or the viewer did not start; the message says what to do instead.
    """
    if "--headless" not in arguments and not _has_display():
        raise ViewerError(f"--view: no display to open the Rerun viewer on; {_ELSEWHERE}")
    port = _free_port()
    command = [sys.executable, "-c", _PROGRAM, "--bind", LOOPBACK, "--port", str(port)]
    command += ["--hide-welcome-screen", "--expect-data-soon", *arguments]
    complaints = tempfile.TemporaryFile()  # noqa: SIM115 (a pipe would break the viewer that outlives its reader)
    try:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=complaints,
            start_new_session=True,  # Ctrl-C ends the run, not the viewer
            env={**os.environ, "RERUN_APP_ONLY": "true", "NO_COLOR": "1"},
        )
    except OSError as error:
        raise ViewerError(f"--view: the Rerun viewer did not start ({error}); {_ELSEWHERE}") from error
    viewer = Viewer(process, port, complaints)
    viewer.await_server()
    return viewer


def _has_display() -> bool:
    wayland_or_x = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return not sys.platform.startswith("linux") or bool(wayland_or_x)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return probe.getsockname()[1]
