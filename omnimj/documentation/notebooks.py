"""Tutorials as notebooks: Markdown files whose code is executed when the site is built.

A tutorial is a notebook in Jupytext's Markdown format: blocks marked `python` are cells, those marked `bash`
are cells for the shell, and everything else is text. JupyterLab opens it as a notebook, with Jupytext; here
its cells run in a kernel, and their results are set below them.
"""

from __future__ import annotations

import base64
import os
import re
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from omnimj.errors import SimulationError

_CELL_LIMIT = 600  # [s], for a machine that compiles kernels first and is busy
_PICTURES = {"image/svg+xml": "svg", "image/png": "png"}
_MAGIC = re.compile(r"%%(bash|sh)\n")
_ANSI = re.compile(r"\x1b\[[0-9;]*[A-Za-z]")


def read_notebook(file: Path) -> Any:
    """Read a tutorial as a notebook (`nbformat.NotebookNode`) without results."""
    import jupytext

    return jupytext.read(file, fmt="md")


def execute_notebook(file: Path) -> Any:
    """Execute a tutorial in an empty temporary folder; return it with results.

    The kernel is reached by sockets in the file system, so that no network is needed, not even that of this
    machine with itself.

    Raises:
      SimulationError: A cell ended with an error; the message has its first line and the error.
    """
    from jupyter_client.manager import KernelManager
    from nbclient import NotebookClient
    from nbclient.exceptions import CellExecutionError

    notebook = read_notebook(file)
    with tempfile.TemporaryDirectory(prefix="omnimj-") as private, tempfile.TemporaryDirectory() as work:
        kernel = KernelManager(kernel_name="python3", connection_file=str(Path(private) / "kernel.json"))
        if os.name == "posix":
            kernel.transport, kernel.ip = "ipc", str(Path(private) / "socket")
        client = NotebookClient(
            notebook, km=kernel, timeout=_CELL_LIMIT, resources={"metadata": {"path": work}}
        )
        # on the main thread the client would answer Ctrl-C and SIGTERM itself, by an error of its own
        with ThreadPoolExecutor(1) as pool:
            try:
                pool.submit(client.execute, env=_environment(private)).result()
            except CellExecutionError as error:
                raise SimulationError(f"tutorial {file.name}: {_reason(notebook, error)}") from None
            finally:
                _close(client, kernel)  # also ends the thread, whose kernel dies
    return notebook


def _close(client: Any, kernel: Any) -> None:
    """End the kernel and close its sockets, which the client of a given kernel leaves open."""
    if client.kc is not None:
        client.kc.stop_channels()
    if kernel.has_kernel:
        kernel.shutdown_kernel(now=True)
    kernel.cleanup_resources()


def _environment(private: str) -> dict[str, str]:
    """Environment of the kernel: the `omnimj` command of this Python, and no settings of the user."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)])
    settings = {"PATH": path, "IPYTHONDIR": private, "MPLCONFIGDIR": private, "COLUMNS": "110"}
    return {**os.environ, **settings}


def _reason(notebook: Any, error: Any) -> str:
    """Failure in one line: first line of the cell, error, and the last lines that it printed."""
    failed = next(cell for cell in notebook.cells if _has_error(cell))
    first = _MAGIC.sub("", failed.source).strip().splitlines()[0]
    printed = "".join(one.text for one in failed.outputs if one.get("name") == "stderr").strip().splitlines()
    last = f" ({_ANSI.sub('', '; '.join(printed[-2:]))})" if printed else ""
    return f"cell {first!r}: {error.ename}: {error.evalue.strip()}{last}"


def _has_error(cell: Any) -> bool:
    return any(output.output_type == "error" for output in cell.get("outputs", ()))


def notebook_page(file: Path, execute: bool) -> str:
    """The page of a tutorial in Markdown, its pictures written beside the file.

    Raises:
      SimulationError: A cell ended with an error.
    """
    notebook = execute_notebook(file) if execute else read_notebook(file)
    parts = []
    for number, cell in enumerate(notebook.cells):
        if cell.cell_type == "markdown":
            parts.append(cell.source)
        else:
            parts.append(_code(cell.source))
            parts += _results(cell, file.with_suffix(""), number)
    return "\n\n".join(parts) + "\n"


def _code(source: str) -> str:
    magic = _MAGIC.match(source)
    language, text = (magic[1], source[magic.end() :]) if magic else ("python", source)
    return f"```{language}\n{text}\n```"


def _results(cell: Any, stem: Path, number: int) -> Iterator[str]:
    """Blocks for what a cell printed, returned and drew; notes on standard error are left out."""
    printed = "".join(one.text for one in cell.get("outputs", ()) if one.get("name") == "stdout")
    if printed.strip():
        yield _text_block(printed)
    for k, output in enumerate(cell.get("outputs", ())):
        content = output.get("data", {})
        kind = next((kind for kind in _PICTURES if kind in content), None)
        if kind is not None:
            yield _picture(content[kind], stem.with_name(f"{stem.name}_{number}_{k}.{_PICTURES[kind]}"))
        elif "text/plain" in content:
            yield _text_block(content["text/plain"])


def _text_block(text: str) -> str:
    body = _ANSI.sub("", text).strip("\n")
    fence = "`" * (3 + max((len(run) for run in re.findall(r"`{3,}", body)), default=0))
    return f'<div class="result" markdown>\n\n{fence}text\n{body}\n{fence}\n\n</div>'


def _picture(content: str, file: Path) -> str:
    """Write a picture and return the block that shows it."""
    if file.suffix == ".svg":
        file.write_text(content, encoding="utf-8")
    else:
        file.write_bytes(base64.b64decode(content))
    return f'<div class="result" markdown>\n\n![Result of the code above]({file.name})\n\n</div>'
