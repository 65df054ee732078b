"""The tables that are worth sending in a TABLES block (SPEC §8.3)."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.blocks.tables import fit_table, pack_tables, table_bits
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import SymbolTable

EDGE = 2**31 - 1
KEY = TableKey(3, 1, 2, 7)

ALPHABETS = st.lists(
    st.one_of(st.integers(-20, 20), st.integers(-EDGE, EDGE), st.sampled_from([-EDGE, EDGE])),
    min_size=1,
    max_size=30,
    unique=True,
).map(sorted)


@settings(deadline=None)
@given(ALPHABETS, st.data())
def test_the_fitted_table_is_never_dearer_than_the_uniform_one(alphabet: list[int], data: st.DataObject) -> None:
    """The cost is that of the table's bytes plus coding. The fitted table is compared with equal weights and with the
    counts themselves."""
    sizes = st.one_of(st.integers(1, 9), st.integers(1, 1 << 20))
    counts = np.array(data.draw(st.lists(sizes, min_size=len(alphabet), max_size=len(alphabet))), np.int64)
    values = np.array(alphabet, np.int64)
    table = fit_table(values, counts)
    uniform = SymbolTable(values, np.ones(len(values), np.int64))

    def cost(of: SymbolTable) -> float:
        return of.cost_of_counts(values, counts) + table_bits(of)

    assert cost(table) <= cost(uniform) + 1e-6 * float(counts.sum())
    assert table.alphabet.tolist() == alphabet


def test_a_fitted_table_is_near_the_entropy() -> None:
    """With many symbols the loss to the empirical entropy, table included, is under 2 %."""
    counts = np.array([50000, 20000, 9000, 4000, 500, 20, 1], np.int64)
    values = np.array([0, -1, 1, 2, -2, 9, 30000], np.int64)
    order = np.argsort(values)
    values, counts = values[order], counts[order]
    entropy = float(-(counts * np.log2(counts / counts.sum())).sum())
    table = fit_table(values, counts)
    assert table.cost_of_counts(values, counts) + 8 * len(pack_tables({KEY: table})) < 1.02 * entropy


def test_equal_tables_cost_few_bits() -> None:
    """The numbers adapt: the hundredth table of a kind costs a fraction of the first."""
    table = SymbolTable(np.array([-1, 0, 1]), np.array([3, 7, 3]))
    one, all_of_them = (len(pack_tables({TableKey(10, j, 2, 0): table for j in range(n)})) for n in (1, 100))
    assert all_of_them < 12 * one
