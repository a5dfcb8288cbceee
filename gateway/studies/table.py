"""What a study found: rows of published beside attained, and its figures."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from rich.table import Table

from gateway.studies.statistics import Interval

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Row:
    """One number: what was published (None where nothing was) and what was attained."""

    id: str
    published: float | None
    attained: Interval
    unit: str

    def plain(self) -> dict[str, Any]:
        """The row as JSON has it: a number that does not exist is null."""
        value, low, high = (x if math.isfinite(x) else None for x in self.attained)
        return {
            "id": self.id,
            "published": self.published,
            "attained": value,
            "low": low,
            "high": high,
            "unit": self.unit,
        }


@dataclass(frozen=True)
class Study:
    """The table of a study; ``figures`` draws each figure of it when asked."""

    name: str
    runs: int
    rows: list[Row]
    figures: dict[str, Callable[[], "Figure"]] = field(default_factory=dict)

    def plain(self, seconds: float) -> dict[str, Any]:
        """The study as JSON has it."""
        return {
            "study": self.name,
            "runs": self.runs,
            "seconds": seconds,
            "rows": [row.plain() for row in self.rows],
        }

    def shown(self) -> Table:
        """The study as a table for a terminal."""
        table = Table(title=self.name)
        for column in ("", "published", "attained", "95 % bounds", "unit"):
            table.add_column(column, no_wrap=True)
        for row in self.rows:
            value, low, high = (f"{x:.4g}" for x in row.attained)
            published = "" if row.published is None else f"{row.published:g}"
            table.add_row(row.id, published, value, f"{low} .. {high}", row.unit)
        return table
