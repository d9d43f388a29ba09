"""Results with a row per case, as tables of pandas, polars and Arrow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from omnimj.signals import to_frame, to_polars


class Tabular:
    """Result with columns of equal length; libraries that read Arrow take it as it is."""

    __slots__ = ()

    def table_columns(self) -> Mapping[str, Sequence[Any]]:
        """Columns by name, a row per case."""
        raise NotImplementedError

    def to_pandas(self) -> Any:
        """A `pandas.DataFrame` with one row per case.

        Raises:
          MissingLibrary: pandas is not installed.
        """
        return to_frame(self.table_columns())

    def to_polars(self) -> Any:
        """A `polars.DataFrame` with one row per case.

        Raises:
          MissingLibrary: polars is not installed.
        """
        return to_polars(self.to_arrow())

    def to_arrow(self) -> Any:
        """A `pyarrow.Table` with one row per case; what a cell has of several values becomes a list."""
        import pyarrow

        return pyarrow.table({name: list(values) for name, values in self.table_columns().items()})

    def __arrow_c_stream__(self, requested_schema: Any = None) -> Any:
        """Arrow's interface between libraries, by which they read the table."""
        return self.to_arrow().__arrow_c_stream__(requested_schema)
