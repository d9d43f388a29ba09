"""Mapping files written as TOML, with comments on what to check."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields

from omnimj.recording.importing.mapping import ColumnSource, LogMapping
from omnimj.recording.importing.propose import Proposal
from omnimj.recording.importing.topics.choice import TopicChoice
from omnimj.recording.write_dataset import toml_key, toml_text

_HEAD = """# How the columns of a log become those of a dataset; edit it, then
#   omnimj import FILE... --mapping THIS_FILE --out DATASET
# column = { from = "its name in the log", unit = "mm/s", scale = 2.0, offset = 0.0 }, offset and scale in SI.
# difference = true: change per second (of a counter); wrap = 65536: it starts over; signed = 16: 65535 is -1;
# sign_of = "a column": a magnitude gets its sign; times = "a column": the product of both.
# floor = "{folder}": the name of the folder of each log.
# [pose] rotation = 0.1: x, y and heading turned by this angle in rad."""


def mapping_text(proposal: Proposal) -> str:
    """Return the text of a mapping file that `read_mapping` reads back; remarks become comments."""
    mapping = proposal.mapping
    lines = [_HEAD, "", f"plant = {toml_text(mapping.plant)}"]
    if mapping.empty != LogMapping.empty:
        lines.append(f"empty = {toml_text(mapping.empty)}")
    lines += ["", "[defaults]", *_conditions(mapping.defaults)]
    lines += [f"# {name.removeprefix('[defaults] ')} = ?" for name in proposal.missing if "]" in name]
    dialect = {f.name: getattr(mapping.dialect, f.name) for f in fields(mapping.dialect)}
    if any(value is not None for value in dialect.values()):
        lines += ["", "[csv]", *_conditions({k: v for k, v in dialect.items() if v is not None})]
    if mapping.topics is not None:
        lines += ["", *_topics(mapping.topics)]
    lines += ["", "[columns]"]
    for target, rule in mapping.columns.items():
        remark = proposal.remarks.get(target)
        lines.append(f"{toml_key(target)} = {_column(rule)}{f'  # {remark}' if remark else ''}")
    lines += [f"# {name} = {{ from = ? }}" for name in proposal.missing if "]" not in name]
    lines += proposal.hints
    if mapping.rotation:
        lines += ["", "[pose]", f"rotation = {mapping.rotation!r}"]
    if mapping.stale is not None:
        lines += ["", "[stale]  # rows in which none of the first changes though one of the second is not 0"]
        lines += [f"unchanged = {_list(mapping.stale.unchanged)}", f"moving = {_list(mapping.stale.moving)}"]
    for name, conditions in mapping.runs.items():
        lines += ["", f"[runs.{toml_key(name)}]", *_conditions(conditions)]
    return "\n".join(lines) + "\n"


def _topics(choice: TopicChoice) -> list[str]:
    words = "# a row at each stamp of this topic; the others are joined to it"
    lines = ["[topics]", f"base = {toml_text(choice.base)}  {words}"] if choice.base else ["[topics]"]
    lines.append(f"join = {toml_text(choice.join)}  # linear or previous")
    if choice.stamps:
        lines.append(f"stamps = {toml_text(choice.stamps)}  # header or log")
    return lines


def _conditions(values: Mapping[str, float | str | bool | int]) -> list[str]:
    return [f"{toml_key(key)} = {toml_text(value)}" for key, value in values.items()]


def _column(rule: ColumnSource) -> str:
    parts = [f"from = {toml_text(rule.source)}"]
    for f in fields(ColumnSource)[1:]:
        value = getattr(rule, f.name)
        if value is not None and value != f.default:
            parts.append(f"{f.name} = {toml_text(value)}")
    return f"{{ {', '.join(parts)} }}"


def _list(names: tuple[str, ...]) -> str:
    return f"[{', '.join(map(toml_text, names))}]"
