"""`omnimj docs`: the documentation as a site, built into a folder or shown on this machine."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.arguments import Command, whole_number
from omnimj.cli.progress import progress_bar

if TYPE_CHECKING:
    from omnimj.documentation.site import SiteBuild

_PORT = 8000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the sub-commands of `omnimj docs`."""
    commands = parser.add_subparsers(title="commands", dest="docs_command", metavar="COMMAND", required=True)
    for command in (_BUILD, _SERVE):
        command.add_to(commands, key="docs_run")


def run(arguments: Any) -> int:
    """Run `omnimj docs build` or `omnimj docs serve`."""
    from omnimj.documentation.site import require_generator

    require_generator()
    return arguments.docs_run(arguments)


def _add_tutorials(parser: argparse.ArgumentParser, default: str) -> None:
    words = f"executed: with results, takes minutes; plain: text and code alone (default {default})"
    parser.add_argument(
        "--tutorials", metavar="T", choices=("executed", "plain"), default=default, help=words
    )


def _add_build_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="folder for the site")
    words = "write into --out although it is not empty; a site there is replaced"
    parser.add_argument("--force", action="store_true", help=words)
    _add_tutorials(parser, "executed")


def _build(arguments: Any) -> int:
    site = _publish(arguments, arguments.out, arguments.force)
    print(f"{len(site.pages)} pages; open {arguments.out / 'index.html'}")
    return 0


def _publish(arguments: Any, folder: Path, force: bool) -> SiteBuild:
    """Build the site into a folder, with a bar of progress."""
    from omnimj.cli.main import make_parser
    from omnimj.documentation.site import publish

    with progress_bar(arguments) as bar:
        execute = arguments.tutorials == "executed"
        return publish(folder, force, make_parser(), execute, bar.show_share)


def _add_serve_arguments(parser: argparse.ArgumentParser) -> None:
    words = f"port on this machine, 0 for any free one (default {_PORT})"
    parser.add_argument("--port", metavar="N", type=whole_number(0, 65535), default=_PORT, help=words)
    _add_tutorials(parser, "plain")


def _serve(arguments: Any) -> int:
    import tempfile

    from omnimj.documentation.server import open_server

    with tempfile.TemporaryDirectory(prefix="omnimj-docs-") as work:
        folder = Path(work) / "site"
        with open_server(arguments.port, folder) as server:
            _publish(arguments, folder, force=False)
            print(f"http://127.0.0.1:{server.server_port}/index.html (Ctrl-C ends it)", flush=True)
            server.serve_forever()
    return 0


_BUILD = Command(
    "build",
    "build the site into a folder; its pages open in a browser without a server",
    """example:
  omnimj docs build --out out/docs""",
    _add_build_arguments,
    _build,
)
_SERVE = Command(
    "serve",
    "build the site and show it to browsers on this machine",
    """example:
  omnimj docs serve --port 8000""",
    _add_serve_arguments,
    _serve,
)
DOCS = Command(
    "docs",
    "build this version's documentation as a site, or serve it on this machine",
    """Works without a network. Needs the extra: pip install 'omnimj[docs]'

examples:
  omnimj docs build --out out/docs
  omnimj docs serve""",
    add_arguments,
    run,
)
