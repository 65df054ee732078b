"""Range asymmetric numeral systems over exact integer frequency tables (SPEC §8).

The decoder runs on constriction. The encoder keeps of each symbol where it lies in its table, and codes all at once in
the C library or, where that is absent, in the ten lines below.

A stream is a sequence of 32-bit words, a stack: the decoder starts from the last word. The encoder
therefore codes the groups it was given in reverse order.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import constriction
import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F64, I32, I64, U8, U32, Ints
from scarfmt.errors import InvalidInput, Malformed
from scarfmt.native.binding import library

PRECISION = 24
TOTAL = 1 << PRECISION
MAX_ALPHABET = 4096

AnsCoder = constriction.stream.stack.AnsCoder
Categorical = constriction.stream.model.Categorical

# The family of models whose tables come as rows, one a symbol. `perfect`: see FrequencyTable.model.
_ROWS = Categorical(perfect=False)


@dataclass(frozen=True)
class FrequencyTable:
    """Integer frequencies of an alphabet 0..n-1: each >= 1, their sum 2^24 (SPEC §8.1).

    An alphabet of one symbol has the frequency 2^24 and codes nothing.

    Attributes:
        frequencies: (n,) int64.
    """

    frequencies: I64
    _cache: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)

    def __post_init__(self) -> None:
        f = self.frequencies
        if not 1 <= len(f) <= MAX_ALPHABET or int(f.min()) < 1 or int(f.sum()) != TOTAL:
            raise InvalidInput(
                "input-table", f"{len(f)} frequencies must each be >= 1 and sum to 2^24 (SPEC §8.1)", field="table"
            )

    @classmethod
    def from_weights(cls, weights: NDArray[np.integer[Any]]) -> FrequencyTable:
        """Frequencies from integer weights (SPEC §8.1).

        Args:
            weights: (n,) non-negative integers, not all zero, sum below 2^39.
        """
        w = np.asarray(weights, dtype=np.int64)
        n = len(w)
        total = int(w.sum())
        if not 1 <= n <= MAX_ALPHABET or int(w.min()) < 0 or not 0 < total < 1 << 39:
            raise InvalidInput(
                "input-table",
                f"{n} weights of sum {total} make no frequency table: it takes 1 to {MAX_ALPHABET} weights and a sum"
                " of 1 to 2^39 - 1 (SPEC §8.1)",
                field="table",
            )
        return cls(scale_weights(w))

    def __len__(self) -> int:
        return len(self.frequencies)

    @cached_property
    def cumulative(self) -> I64:
        """(n + 1,) int64 exclusive prefix sums, ending in 2^24."""
        return np.concatenate(([0], np.cumsum(self.frequencies)))

    def spans(self, symbols: Ints) -> tuple[I64, I64]:
        """(n,) first slots of `symbols`, integers in 0..n-1, and those past the last.

        Raises:
            InvalidInput: ``input-symbol``.
        """
        _check_symbols(symbols, len(self))
        return self.cumulative[symbols], self.cumulative[1:][symbols]

    @cached_property
    def bits(self) -> NDArray[np.float64]:
        """(n,) float64 cost of each symbol in bits, -log2(f / 2^24)."""
        return PRECISION - np.log2(self.frequencies.astype(np.float64))

    @property
    def model(self) -> Any:
        """constriction's model of exactly these frequencies.

        With weights f - 1 its free mass 2^24 - n equals their sum, so its scale is exactly 1 and its
        cumulative table is exactly ours. `perfect` must be passed: its default changed between versions.
        """
        if "model" not in self._cache:
            self._cache["model"] = Categorical((self.frequencies - 1).astype(np.float64), perfect=False)
        return self._cache["model"]


def scale_weights(weights: I64) -> I64:
    """(..., n) frequencies of (..., n) weights, by exact prefix sums (SPEC §8.1).

    With C_i the sum of the first i of n weights, the cumulative frequency is
    c_i = floor(C_i * (2^24 - n) / C_n) + i. Integer arithmetic throughout: the product stays below
    2^63 while C_n < 2^39.
    """
    n = weights.shape[-1]
    prefix = np.cumsum(weights, axis=-1)
    cumulative = prefix * (TOTAL - n) // prefix[..., -1:] + np.arange(1, n + 1)
    return np.asarray(np.diff(cumulative, axis=-1, prepend=0))


def uniform_table(size: int) -> FrequencyTable:
    """The frequency table of `size` equally weighted symbols, as §8.1 makes it from weights of 1."""
    return FrequencyTable.from_weights(np.ones(size, np.int64))


# Few sizes are in use; large tables take 130 KB each with their model, so not all of them are kept.
@lru_cache(maxsize=128)
def make_uniform(size: int) -> FrequencyTable:
    """The uniform table of `size` symbols, made once."""
    return uniform_table(size)


class RansEncoder:
    """Collects groups of symbols in decoding order; :meth:`finish` codes them in reverse."""

    def __init__(self) -> None:
        # (n, 2) uint32 of each group: first slots of its symbols in their tables, and those past the last.
        self._spans: list[U32] = []

    def encode(self, symbols: Ints, table: FrequencyTable) -> None:
        """Append `symbols`, (count,) integers in 0..n-1, coded with `table`.

        Raises:
            InvalidInput: ``input-symbol``.
        """
        self.append(*table.spans(symbols))

    def encode_rows(self, symbols: Ints, weights: F64) -> None:
        """Append `symbols`, each coded with a frequency table of its own (SPEC §8.1, §10.5).

        Args:
            symbols: (n,) integers in 0..k-1.
            weights: (n, k) float64, the frequencies minus 1: integers >= 0, each row's sum 2^24 - k. With k = 1
                nothing is coded.

        Raises:
            InvalidInput: ``input-symbol``, ``input-table``.
        """
        check_rows(weights, len(symbols))
        _check_symbols(symbols, weights.shape[1])
        rows = np.arange(len(symbols))
        past = np.cumsum(weights, axis=1)[rows, symbols] + symbols + 1
        self.append(past - weights[rows, symbols] - 1, past)

    def append(self, first: Ints | F64, past: Ints | F64) -> None:
        """Append symbols by their (n,) spans: first <= slot < past."""
        self._spans.append(np.stack([first, past], axis=1).astype(np.uint32))

    def finish(self) -> bytes:
        """The sealed stream: 32-bit little-endian words, empty when nothing was coded."""
        if not self._spans:
            return b""
        spans = np.concatenate(self._spans)
        if library() is None:
            return _code(*spans.T.tolist())
        return code_groups(np.array([[0, len(spans)]]), np.zeros(0, np.uint8), spans.view(np.int32))


def code_groups(groups: I64, contexts: U8, values: I32, tables: object = None) -> bytes:
    """The sealed stream of some groups, by the C library.

    Args:
        groups, contexts, values: of :class:`scarfmt.entropy.recorded.RecordedSymbols`, or one group of the name 0 and
            its (n, 2) spans.
        tables: a pointer to a `SideBySide`, if any is in force.

    Raises:
        InvalidInput: ``input-symbol``.
    """
    native, sizes = library(), groups[:, 1]
    assert native is not None
    words, spans = np.empty(int(sizes.sum()) + 2, np.uint32), np.empty((int(sizes.max(initial=0)), 2), np.uint32)
    ends = contexts.ctypes.data + contexts.nbytes, values.ctypes.data + values.nbytes
    given = tables, groups.ctypes.data, len(groups), *ends
    count = native.scar_code(*given, spans.ctypes.data, words.ctypes.data)
    if count < 0:
        raise symbol_refusal()
    return words[:count].astype("<u4").tobytes()


def symbol_refusal() -> InvalidInput:
    """The refusal of a symbol for which there is no place in the table."""
    return InvalidInput("input-symbol", "a value that no table holds", field="symbols")


def _code(first: list[int], past: list[int]) -> bytes:
    """The words of some spans (SPEC §8.2)."""
    state, words = 0, []
    for start, end in zip(reversed(first), reversed(past), strict=True):
        frequency = end - start
        if state >> (64 - PRECISION) >= frequency:
            words.append(state & 0xFFFFFFFF)
            state >>= 32
        state = (state // frequency << PRECISION) + state % frequency + start
    while state:
        words.append(state & 0xFFFFFFFF)
        state >>= 32
    return np.array(words, "<u4").tobytes()


def _check_symbols(symbols: Ints, size: int) -> None:
    if len(symbols) and (int(symbols.min()) < 0 or int(symbols.max()) >= size):
        raise InvalidInput("input-symbol", f"symbol outside the alphabet of {size}", field="symbols")


def check_rows(rows: F64, count: int) -> None:
    """Refuse rows that are not `count` frequency tables minus 1."""
    if rows.ndim != 2 or len(rows) != count or not 1 <= rows.shape[1] <= MAX_ALPHABET:
        raise InvalidInput("input-table", f"rows of shape {rows.shape} for {count} symbols", field="table")
    sums = rows.sum(axis=1)
    if count and (
        bool((rows < 0).any() or (rows != np.floor(rows)).any()) or bool((sums != TOTAL - rows.shape[1]).any())
    ):
        raise InvalidInput(
            "input-table", "a row of frequencies minus 1 must be integers >= 0 that sum to 2^24 - k", field="table"
        )


def words_of(data: bytes) -> NDArray[np.uint32]:
    """The 32-bit words of a stream (SPEC §8.2).

    Raises:
        Malformed: ``rans-length``, ``rans-last-word``.
    """
    if len(data) % 4:
        raise Malformed("rans-length", f"a rANS stream of {len(data)} bytes is not whole 32-bit words (SPEC §8.2)")
    words = np.frombuffer(data, dtype="<u4").astype(np.uint32)
    if len(words) and words[-1] == 0:
        raise Malformed("rans-last-word", "the last word of a rANS stream must not be zero (SPEC §8.2)")
    return words


class RansDecoder:
    """Decodes a stream, group by group, on constriction's AnsCoder.

    Raises:
        Malformed: ``rans-length``, ``rans-last-word``.
    """

    def __init__(self, data: bytes) -> None:
        self._coder = AnsCoder(words_of(data))

    def decode(self, table: FrequencyTable, count: int) -> I32:
        """The next `count` symbols, (count,) int32. `count` must come from a validated number."""
        if len(table) == 1 or count == 0:
            return np.zeros(count, np.int32)
        return np.asarray(self._coder.decode(table.model, count), dtype=np.int32)

    def decode_rows(self, weights: F64) -> I32:
        """The next len(weights) symbols, (n,) int32, each with the frequencies weights[i] + 1.

        Args:
            weights: (n, k) float64 as :meth:`RansEncoder.encode_rows` takes them; not checked here.
        """
        if weights.shape[1] == 1 or not len(weights):
            return np.zeros(len(weights), np.int32)
        rows = np.ascontiguousarray(weights, dtype=np.float64)
        return np.asarray(self._coder.decode(_ROWS, rows), dtype=np.int32)

    def finish(self) -> None:
        """Check the end state (SPEC §8.2).

        Raises:
            Malformed: ``rans-seal`` when words or state are left.
        """
        if not self._coder.is_empty():
            message = "the rANS stream does not end in the empty state (SPEC §8.2): it is damaged"
            raise Malformed("rans-seal", message)
