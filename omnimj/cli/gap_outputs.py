"""What `omnimj gap` leaves behind: the files of its folder, and the tables on the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnimj.cli.tables import table

if TYPE_CHECKING:
    from omnimj.gap.records import Finding

MODEL, FLOORS, DIGEST, REPORT, RECORDING = FILES = (
    "model.toml",
    "floors.toml",
    "gap.json",
    "report.html",
    "before_after.rrd",
)
"""What a search writes, in this order."""


def write_outputs(
    folder: Path,
    force: bool,
    finding: Finding,
    machine_file: Path | None,
    command: str,
    texts: Mapping[str, str],
) -> dict[str, Any]:
    """Writes new model and floors, `gap.json`, `report.html`, `before_after.rrd`, each whole or not at all.

    Args:
      folder: Created if needed.
      force: Whether the files of an earlier search may be replaced.
      finding: What was found.
      machine_file: The model file that was given; None for the shipped one.
      command: What repeats the work.
      texts: Contents of `MODEL` and `FLOORS`; empty where nothing was added or refitted.

    Returns:
      The content of `gap.json`.

    Raises:
      InputError: The folder is not empty and `force` is not given, or it cannot be written.
    """
    from omnimj.gap.digest import digest, write_digest
    from omnimj.recording.folder import make_folder, whole_file
    from omnimj.view.gap_recording import write_before_after
    from omnimj.view.gap_report import write_gap_report

    make_folder(folder, force, FILES)
    for name in (MODEL, FLOORS):
        if name in texts:
            with whole_file(folder / name) as temporary:
                temporary.write_text(texts[name], encoding="utf-8")
        else:  # of an earlier search, which `force` replaces
            (folder / name).unlink(missing_ok=True)
    model, floors = (name if name in texts else None for name in (MODEL, FLOORS))
    content = digest(finding, model, floors, command)
    with whole_file(folder / DIGEST) as temporary:
        write_digest(temporary, content)
    with whole_file(folder / REPORT) as temporary:
        write_gap_report(temporary, finding, model, floors, command)
    if finding.overlays:
        with whole_file(folder / RECORDING) as temporary:
            write_before_after(temporary, finding, machine_file)
    return content


def told(finding: Finding, folder: Path, content: Mapping[str, Any]) -> str:
    """The verdict, where the gap is, what is missing, how much smaller it is, what next."""
    from omnimj.gap import sentences

    new = [f"the new model is {folder / content['model']}"] if content["model"] else []
    new += [f"the refitted floors are {folder / content['floors']}"] if content["floors"] else []
    parts = [
        f"{sentences.headline(finding)}\n{sentences.summary(finding)}",
        _reason(finding),
        _where(finding),
        _effects(finding),
        _gaps(finding),
        _next(finding),
        "; ".join([f"written to {folder}", *new]),
    ]
    return "\n\n".join(part for part in parts if part)


def _reason(finding: Finding) -> str:
    from omnimj.gap.sentences import sentence

    return sentence(finding.reason)


def _where(finding: Finding) -> str:
    from omnimj.gap.sentences import amount, percent, regime

    rows = []
    for place in finding.where:
        unit = finding.channels.get(place.channel, ("", ""))[0]
        rows.append(
            (
                percent(place.share),
                place.channel,
                amount(place.before, unit),
                amount(place.after, unit),
                regime(place),
            )
        )
    return _titled("where", ("share", "channel", "before", "after", "regime"), rows)


def _effects(finding: Finding) -> str:
    from omnimj.gap.sentences import amount, digits, joined, label, percent

    rows, notes = [], []
    for effect in finding.effects:
        p_false = "–" if effect.p_false is None else digits(effect.p_false, 2)
        first = (label(effect), percent(effect.gain.value), p_false)
        for k, (name, value) in enumerate(effect.parameters.items()):
            low, high = amount(value.low, "1"), amount(value.high, "1")
            shown = (name, amount(value.value, value.unit), f"{low} … {high}")
            rows.append((*(first if k == 0 else ("", "", "")), *shown))
        if effect.indistinguishable_from:
            rivals = joined(effect.indistinguishable_from, "or")
            notes.append(f"{label(effect)} cannot be told from {rivals} by these data")
    head = ("effect", "gain", "p_false", "parameter", "value", "90 %")
    return "\n".join(part for part in (_titled("what is missing", head, rows), *notes) if part)


def _gaps(finding: Finding) -> str:
    from omnimj.gap.sentences import amount, percent

    rows = []
    for channel, gap in finding.heldout.items():
        unit = finding.channels.get(channel, ("", ""))[0]
        smaller = "–" if gap.after is None or not gap.before else percent(1.0 - gap.after / gap.before)
        rows.append(
            (
                channel,
                amount(gap.before, unit),
                amount(gap.after, unit),
                smaller,
                amount(gap.floor, unit),
                amount(finding.noise.get(channel), unit),
            )
        )
    head = ("channel", "before", "after", "smaller by", "repeats", "noise")
    return _titled("RMS mismatch on held-out runs", head, rows)


def _next(finding: Finding) -> str:
    from omnimj.gap import sentences
    from omnimj.view.gap_tables import conditions

    lines = [f"next: {sentences.next_step(finding)}"]
    if finding.next_experiment:
        driven = finding.next_experiment.get("run") or {}
        lines += [f"run to drive: {conditions(driven)}", sentences.separates(finding)]
    return "\n".join(lines)


def _titled(title: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return f"{title}\n{table(head, rows)}" if rows else ""
