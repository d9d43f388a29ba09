"""What a message must hold, without its wording."""

from __future__ import annotations

import re


def mentions(text: str, *parts: str) -> bool:
    """Whether one line holds the parts in their order: place, value, rule, choices."""
    return re.search(".*?".join(re.escape(part) for part in parts), text) is not None
