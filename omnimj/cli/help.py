"""What `omnimj` says of itself: the first meeting, and the list of sub-commands by what they are for."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping

from omnimj import __version__

WELCOME = f"""omnimj {__version__}: a MuJoCo twin of a four-wheel omni robot and of its test rig,
with faults and their diagnosis, and a way from measured runs to what the model
lacks.

  omnimj run nylon_patch --out out/nylon
      drives a scenario and judges it; open out/nylon/report.html, or add --view
      to watch it live
  omnimj scenarios
      lists what else can be driven
  omnimj gap DATASET --out out/gap
      says where the model parts from measured runs, and by which effect;
      without a robot, `omnimj record rig_mixed --out DATASET` makes such runs

All commands: omnimj --help. One of them, with examples: omnimj run --help.
"""

Groups = Mapping[str, tuple[str, ...]]
"""What commands are for → their names."""


class GroupedHelp(argparse.RawDescriptionHelpFormatter):
    """Lists the sub-commands of a parser under headings; one without a heading comes last."""

    def __init__(self, prog: str, groups: Groups):
        super().__init__(prog)
        self._groups = groups

    def _format_action(self, action: argparse.Action) -> str:
        if not isinstance(action, argparse._SubParsersAction):
            return super()._format_action(action)
        self._action_max_length += self._indent_increment  # the headings indent once more
        return "\n".join(self._blocks({one.dest: one for one in action._get_subactions()}))

    def _blocks(self, listed: dict[str, argparse.Action]) -> Iterator[str]:
        for title, names in (*self._groups.items(), ("Other", tuple(listed))):
            found = [listed.pop(name) for name in names if name in listed]
            if not found:
                continue
            self._indent()
            lines = "".join(super(GroupedHelp, self)._format_action(one) for one in found)
            self._dedent()
            yield f"{' ' * self._current_indent}{title}\n{lines}"
