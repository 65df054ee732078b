"""Rules over all rows of a table at once: the error names the first row that breaks one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import I64, Bools
from scarfmt.errors import Malformed, ScarError

Table = NDArray[np.void]


@dataclass(frozen=True)
class TableRules:
    """Checks of one table.

    Attributes:
        rows: (n,) of it.
        name: what a row is called in messages, such as ``"page[3].tile"``.
        offsets: (n,) absolute offsets of the rows in the file, or one of the structure that holds them all.
        first: number of the first row.
    """

    rows: Table
    name: str
    offsets: I64 | int
    first: int = 0

    def check(self, ok: Bools, refusal: str, column: str, rule: str, error: type[ScarError] = Malformed) -> None:
        """Raise `error` with the id `refusal` where (n,) `ok` does not hold; `column` is what the rule is about."""
        if ok.all():
            return
        row = int(np.argmin(ok))
        raise error(
            refusal,
            f"{self.rows[column][row]}: {rule}",
            offset=self.offsets if isinstance(self.offsets, int) else int(self.offsets[row]),
            field=f"{self.name}[{self.first + row}].{column}",
        )


def total(column: NDArray[np.generic]) -> int:
    """The exact sum of non-negative integers below 2^64."""
    most = int(column.max(initial=0)) * len(column)
    return int(column.sum(dtype=np.uint64)) if most < 1 << 64 else sum(map(int, column))
