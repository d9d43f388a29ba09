"""Recording files: collected in memory, then written in full or not at all.

Rerun's own file sink writes in a thread of its own. When the disk is full it leaves half a file without an
error, and waiting for it never ends.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rerun as rr

from omnimj.recording.folder import atomic_file


@contextmanager
def recording_file(path: Path, application: str) -> Iterator[rr.RecordingStream]:
    """Context with a stream whose data become a recording file when the block succeeds.

    Args:
      path: `.rrd` file to write.
      application: Identifier for which the viewer keeps one layout.

    Raises:
      OutputError: The file cannot be written.
    """
    stream = rr.RecordingStream(application)
    recorded = stream.memory_recording()
    try:
        yield stream
        content = recorded.drain_as_bytes()
    finally:
        stream.disconnect()
    with atomic_file(path) as temporary:
        temporary.write_bytes(content)
