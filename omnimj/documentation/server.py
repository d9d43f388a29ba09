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


class SiteServer(ThreadingHTTPServer):
    """Server with an open port, closed at the end of its context."""

    daemon_threads = True

    def serve(self, folder: Path) -> None:
        """Serve the files of a folder until `shutdown` is called or the program is interrupted."""
        self.RequestHandlerClass = functools.partial(_QuietHandler, directory=str(folder))
        self.serve_forever(poll_interval=0.1)


def open_server(port: int) -> SiteServer:
    """Open a server on 127.0.0.1; port 0 is any free one.

    Raises:
      InputError: The port is taken, or needs a right that is missing.
    """
    try:
        return SiteServer((_HOST, port), _QuietHandler)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(f"--port {port}", f"cannot be used, {reason}", "choose another, or 0") from None
