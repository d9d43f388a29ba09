"""Opens a recording in the Rerun viewer."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from omnimj.errors import OmnimjError

_LOOPBACK = "127.0.0.1"
_SETTLING = 3.0  # [s] a viewer that lives longer has found its window


class ViewerError(OmnimjError, RuntimeError):
    """No Rerun viewer could be opened."""


def open_viewer(recording: Path) -> None:
    """Opens a recording in a viewer of its own; its server listens on the loopback address only.

    Args:
      recording: An `.rrd` file.

    Raises:
      ViewerError: No display, or the viewer ended at once; the message says how to see the recording.
    """
    elsewhere = f"copy {recording} to a computer with a display and run `rerun {recording.name}`"
    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise ViewerError(f"--view: no display to open the Rerun viewer on; {elsewhere}")
    command = [sys.executable, "-m", "rerun", "--bind", _LOOPBACK, "--port", "auto", str(recording)]
    try:
        viewer = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True
        )
        _, complaint = viewer.communicate(timeout=_SETTLING)
    except subprocess.TimeoutExpired:
        return  # it runs, and lives on when this process ends
    except OSError as error:
        raise ViewerError(f"--view: the Rerun viewer did not start ({error}); {elsewhere}") from error
    if viewer.returncode != 0:
        last = complaint.decode(errors="replace").strip().splitlines()
        reason = last[-1] if last else f"exit status {viewer.returncode}"
        raise ViewerError(f"--view: the Rerun viewer ended at once ({reason}); {elsewhere}")
