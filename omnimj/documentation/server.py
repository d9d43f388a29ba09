"""A server for the site that only this machine can reach."""

from __future__ import annotations

import functools
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from omnimj.errors import InputError

_HOST = "127.0.0.1"  # the loopback interface alone


class _QuietHandler(SimpleHTTPRequestHandler):
    """Serves the files of a folder without a line for each request."""

    def log_message(self, format: str, *arguments: Any) -> None:
        """Print nothing."""


def open_server(port: int, folder: Path) -> ThreadingHTTPServer:
    """Open a server on 127.0.0.1 for the files of a folder, which may come later; port 0 is any free one.

    Raises:
      InputError: The port is taken, or needs a right that is missing.
    """
    try:
        return ThreadingHTTPServer((_HOST, port), functools.partial(_QuietHandler, directory=str(folder)))
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(f"--port {port}", f"cannot be used, {reason}", "choose another, or 0") from None
