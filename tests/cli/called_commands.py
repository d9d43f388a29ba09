"""Commands called in this process, with what they print."""

from __future__ import annotations

from omnimj.cli.main import main


def called(capsys, *argv: str) -> tuple[int, str, str]:
    """Exit code, stdout, stderr."""
    code = main(list(argv))
    out, err = capsys.readouterr()
    return code, out, err


def called_compiled(capsys, *argv: str) -> tuple[int, str, list[str]]:
    """Exit code, stdout, lines of stderr without those on compiling."""
    code, out, err = called(capsys, *argv)
    return code, out, [line for line in err.splitlines() if not line.startswith("compiling")]
