"""Rerun viewer in a separate process."""

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
"""Address of the viewer's server; Rerun's default of all interfaces would expose the run to the network."""
_PROGRAM = (
    "import sys; from rerun_cli.__main__ import main; sys.exit(main())"  # `-m rerun_cli` loses the exit code
)
_START_TIMEOUT = 30.0  # [s] for a viewer to start on a slow machine
_OPENING = 0.6  # [s] a viewer without a display accepts connections before it ends
_WINDOW_TIMEOUT = 3.0  # [s] a viewer that runs longer has opened its window
_POLL_INTERVAL = 0.02  # [s]
_ELSEWHERE = "use --out DIR instead, copy DIR/run.rrd to a computer with a display, run `rerun run.rrd` there"


class ViewerError(OmnimjError, RuntimeError):
    """Error raised when a Rerun viewer could not be opened or failed."""


class Viewer:
    """Running viewer, which outlives this process."""

    def __init__(self, process: subprocess.Popen[bytes], port: int, error_output: IO[bytes]):
        """Wrap a viewer's process, the port it listens on, and the file with its error output."""
        self._process, self._port, self._error_output = process, port, error_output
        self._born = time.monotonic()

    @property
    def url(self) -> str:
        """Address of the viewer's server."""
        return f"rerun+http://{LOOPBACK}:{self._port}/proxy"

    @property
    def is_open(self) -> bool:
        """True while the viewer is running."""
        return self._process.poll() is None

    def connect(self, stream: rr.RecordingStream, blueprint: rrb.Blueprint) -> None:
        """Connect a stream to this viewer, with a blueprint for its layout."""
        stream.connect_grpc(self.url)
        stream.send_blueprint(blueprint)  # made active, since the viewer may remember an older one

    def await_server(self) -> None:
        """Wait until the viewer accepts connections and has survived opening its display.

        Raises:
          ViewerError: The viewer ended or does not answer; it is then terminated.
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
        """Wait until a viewer without a window would have ended, then detach; raise an error if it failed."""
        while self.is_open and time.monotonic() < self._born + _WINDOW_TIMEOUT:
            time.sleep(_POLL_INTERVAL)
        try:
            self.check()
        finally:
            self.leave()

    def leave(self) -> None:
        """Close the file with the error output; the viewer keeps running."""
        self._error_output.close()

    def check(self) -> None:
        """Raise an error with the output of the viewer if it failed."""
        if self._process.poll() in (None, 0):
            return
        self._error_output.seek(0)
        lines = self._error_output.read().decode(errors="replace").splitlines()
        errors = [line for line in lines if "error" in line.lower() or "panic" in line.lower()]
        reason = (
            errors[-1].rsplit(": ", 1)[-1].strip() if errors else f"exit status {self._process.returncode}"
        )
        raise ViewerError(f"--view: the Rerun viewer failed ({reason}); {_ELSEWHERE}")


def open_viewer(arguments: Sequence[str] = ()) -> Viewer:
    """Open a viewer that listens on the loopback address only, with options of `rerun`; wait for it.

    Raises:
      ViewerError: There is no display, or the viewer did not start; the message suggests an alternative.
    """
    if "--headless" not in arguments and not _has_display():
        raise ViewerError(f"--view: no display to open the Rerun viewer on; {_ELSEWHERE}")
    port = _free_port()
    command = [sys.executable, "-c", _PROGRAM, "--bind", LOOPBACK, "--port", str(port)]
    command += ["--hide-welcome-screen", "--expect-data-soon", *arguments]
    error_output = tempfile.TemporaryFile()  # noqa: SIM115 (a pipe would break the viewer that outlives its reader)
    try:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=error_output,
            start_new_session=True,  # Ctrl-C ends the run, not the viewer
            env={**os.environ, "RERUN_APP_ONLY": "true", "NO_COLOR": "1"},
        )
    except OSError as error:
        raise ViewerError(f"--view: the Rerun viewer did not start ({error}); {_ELSEWHERE}") from error
    viewer = Viewer(process, port, error_output)
    viewer.await_server()
    return viewer


def _has_display() -> bool:
    wayland_or_x = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return not sys.platform.startswith("linux") or bool(wayland_or_x)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return probe.getsockname()[1]
