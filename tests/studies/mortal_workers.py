"""Work that kills its worker; a worker that imports this imports nothing else of the tests."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path


def die_once(mark: Path, number: int) -> dict[str, int]:
    """Its worker is killed by the first to come by."""
    try:
        mark.open("x").close()
    except FileExistsError:
        return {"number": number}
    os.kill(os.getpid(), signal.SIGKILL)
    return {}


def die_last(number: int) -> dict[str, int]:
    """The last of three kills its worker, every time, when the worker has reported what it did before."""
    if number == 2:
        time.sleep(0.3)
        os.kill(os.getpid(), signal.SIGKILL)
    return {"number": number}


def numbered(number: int) -> dict[str, int]:
    """Kills nothing."""
    return {"number": number}
