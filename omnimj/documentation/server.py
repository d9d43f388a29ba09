"""A server for the site that only this machine can reach."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from omnimj.errors import InputError

_HOST = "127.0.0.1"  # the loopback interface alone


class _QuietHandler(SimpleHTTPRequestHandler):
    """Serves the files of a folder without a line for each request."""

    def log_message(self, format: str, *arguments: Any) -> None:
        """Print nothing."""


class SiteServer:
    """Server with an open port."""

    def __init__(self, server: ThreadingHTTPServer):
        self._server = server

    @property
    def address(self) -> str:
        """Address on which the server listens."""
        return str(self._server.server_address[0])

    @property
    def port(self) -> int:
        """Port on which the server listens."""
        return int(self._server.server_address[1])

    def serve(self, folder: Path) -> None:
        """Serve the files of a folder until `stop` is called or the program is interrupted."""
        self._server.RequestHandlerClass = functools.partial(_QuietHandler, directory=str(folder))
        self._server.serve_forever(poll_interval=0.1)

    def stop(self) -> None:
        """End `serve`, called from another thread."""
        self._server.shutdown()


@contextmanager
def open_server(port: int) -> Iterator[SiteServer]:
    """Context with a server on 127.0.0.1.

    Args:
      port: Port; 0 for any free one.

    Raises:
      InputError: The port is taken, or needs a right that is missing.
    """
    try:
        server = ThreadingHTTPServer((_HOST, port), _QuietHandler)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(f"--port {port}", f"cannot be used, {reason}", "choose another, or 0") from None
    server.daemon_threads = True
    try:
        yield SiteServer(server)
    finally:
        server.server_close()
