"""Objects of BokehJS, Bokeh's part in the browser, written without Bokeh's Python classes.

Those check each attribute and make each default of each object: for the report of a short run they take
longer than the run. BokehJS needs only the attributes that differ from its defaults. Their names and values
are those of `bokeh.models`, to which `python_models` converts them, with all its checks.
"""

from __future__ import annotations

import itertools
from typing import Any

from bokeh.core.property.vectorization import Field, Value
from bokeh.core.serialization import Deserializer, Ref, Serializable, Serializer
from bokeh.core.types import ID

__all__ = ["Field", "Model", "Value", "encode", "in_frame", "python_models"]

_numbers = itertools.count(1)


class Model(Serializable):
    """Object of BokehJS of a kind, such as `Line`, with its attributes."""

    def __init__(self, kind: str, **attributes: Any) -> None:
        self.kind, self.id = kind, ID(f"p{next(_numbers)}")
        self.__dict__.update(attributes)

    def to_serializable(self, serializer: Serializer) -> Any:
        """Describe the object once; where it occurs again, Bokeh refers to it by its `id`."""
        serializer.add_ref(self, Ref(id=self.id))
        attributes = {
            name: serializer.encode(value) for name, value in vars(self).items() if name not in ("kind", "id")
        }
        return {"type": "object", "name": self.kind, "id": self.id, "attributes": attributes}


def in_frame(side: str, offset: int = 0) -> Model:
    """Place at a side of the frame of a plot, such as `top`, whatever its axes show; offset [pixels]."""
    return Model("Node", target="frame", symbol=side, offset=offset)


def encode(*values: Any) -> list[Any]:
    """Describe values in JSON; an object that several of them contain is described once."""
    serializer = Serializer(deferred=False)
    return [serializer.encode(value) for value in values]


def python_models(model: Model) -> Any:
    """Convert an object and those below it to the classes of `bokeh.models`, which check all attributes.

    Raises:
      ValueError: Bokeh does not know a kind or a value. An unknown attribute is a warning of its log.
    """
    import bokeh.plotting  # noqa: F401  registers the classes, which pages do not need

    return Deserializer().decode(*encode(model))
