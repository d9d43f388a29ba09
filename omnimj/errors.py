"""The exceptions of omnimj, one family.

Loaders and constructors raise; inside the control loop bad data is a value, which the limits turn into zero
current.
"""

from __future__ import annotations

import difflib
import os
from collections.abc import Callable, Iterable, Sequence

_LONGEST = 200  # a finding may be a whole table or all the text of a file


class OmnimjError(Exception):
    """Root of every error that omnimj raises on purpose."""


class InputError(OmnimjError, ValueError):
    """A value given by a user breaks a rule.

    The message is one line: the place, what was found, what is allowed.
    """

    def __init__(self, place: object, found: str, rule: str = "", choices: Iterable[str] = ()):
        message = f"{place}: {found if len(found) <= _LONGEST else found[: _LONGEST - 1] + '…'}"
        if rule:
            message += f"; {rule}"
        names = sorted(choices)
        if names:
            message += f"; choices: {', '.join(names)}"
        super().__init__(message)

    def __reduce__(self) -> tuple[Callable[..., OmnimjError], tuple[type[OmnimjError], str]]:
        """Travel between processes as kind and message: workers report errors, too."""
        return _with_message, (type(self), str(self))


def _with_message(kind: type[OmnimjError], message: str) -> OmnimjError:
    error = kind.__new__(kind, message)
    error.args = (message,)
    return error


class UnknownNameError(InputError, LookupError):
    """A name outside its list of choices; the message gives the choices."""

    def __init__(self, place: object, kind: str, name: object, choices: Iterable[str]):
        names = list(choices)
        close = difflib.get_close_matches(str(name), names, n=1)
        hint = f"did you mean '{close[0]}'?" if close else ""
        super().__init__(place, f"unknown {kind} {name!r}", hint, names)


class MissingLibrary(InputError, ImportError):
    """A library of an optional extra that is not installed; the message names the extra to install."""

    def __init__(self, place: object, library: str, extra: str):
        super().__init__(place, f"{library} is not installed", f"pip install 'omnimj[{extra}]'")


class OutputError(OmnimjError, OSError):
    """A file that cannot be written: a full disk, a missing right.

    The message is one line: the place, the reason, what can be done.
    """

    def __init__(self, place: object, reason: str, rule: str = ""):
        super().__init__(f"{place}: cannot be written, {reason}{f'; {rule}' if rule else ''}")

    def __reduce__(self) -> tuple[Callable[..., OmnimjError], tuple[type[OmnimjError], str]]:
        """Travel between processes as kind and message."""
        return _with_message, (type(self), str(self))


def write_failure(place: object, error: OSError, rule: str = "") -> OutputError:
    """Return the error that reports what cannot be written, with the system's reason."""
    if isinstance(error, OutputError):
        return error
    return OutputError(place, os.strerror(error.errno).lower() if error.errno else str(error), rule)


class DataFaultError(InputError):
    """Recorded data are wrong for certain, in time, unit, sign or delay, and were not accepted."""

    def __init__(self, place: object, faults: Sequence[str], rule: str):
        many = f"{len(faults)} sure faults" if len(faults) > 1 else "a sure fault"
        Exception.__init__(self, f"{place}: {many} of the data: {'; '.join(faults)}; {rule}")


class NativeLayoutError(OmnimjError, RuntimeError):
    """The installed MuJoCo does not have the memory layout that the native contact needs."""


class SimulationError(OmnimjError, RuntimeError):
    """The state of a simulation is no longer valid: not finite, or MuJoCo warned."""


class LinkLost(OmnimjError, ConnectionError):
    """The link to the robot is too poor for motion; a stop was commanded."""


class NoAnswer(LinkLost):
    """The machine on the wire does not answer a request."""
