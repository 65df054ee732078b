"""Shared parts of the tests of the compiled library: outcomes with it and without, streams and tables of any
numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import strategies as st

from scarfmt.arrays import F32, F64, I64
from scarfmt.coding.engine import NUMPY_ENGINE, Engine
from scarfmt.engines import absence
from scarfmt.entropy.rans import FrequencyTable, PureRansDecoder
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import ScarError
from scarfmt.kernel.engine import KernelEngine
from scarfmt.kernel.loading import load
from scarfmt.kernel.stream_decoder import KernelRansDecoder
from scarfmt.neural.operations import NUMPY
from scarfmt.neural.tables import exp2_table

EXTREME = (1 << 31) - 1

needs_kernel = pytest.mark.skipif(absence() is not None, reason=f"no kernel: {absence()}")

SEEDS = st.integers(0, 2**32 - 1)
# Zeros and ones bring out words that are about to be used up, and states at the ends of their range.
_WORDS = st.one_of(st.integers(0, 2**32 - 1), st.sampled_from([0, 1, 2**32 - 1]))


@st.composite
def streams(draw: st.DrawFn, max_words: int = 60) -> bytes:
    """Any stream that may be opened: whole words, the last not 0; most are no valid ones."""
    words = draw(st.lists(_WORDS, max_size=max_words))
    if words and not words[-1]:
        words[-1] = draw(st.integers(1, 2**32 - 1))
    return np.array(words, "<u4").tobytes()


def random_stream(rng: np.random.Generator, words: int) -> bytes:
    """Long random streams."""
    out = rng.integers(0, 1 << 32, words, np.uint32)
    out[-1:] |= np.uint32(1)
    return out.astype("<u4").tobytes()


def random_weights(rng: np.random.Generator, size: int, top: int = (1 << 24) - 1) -> I64:
    """(size,) weights from 1, evenly spread or over all magnitudes."""
    if rng.random() < 0.5:
        return rng.integers(1, top + 1, size)
    return np.maximum(np.exp2(rng.uniform(0, np.log2(top), size)).astype(np.int64), 1)


def random_table(rng: np.random.Generator, size: int) -> SymbolTable:
    """Any values, the ends of the range among them."""
    alphabet = np.unique(np.concatenate([rng.integers(-EXTREME, EXTREME + 1, size), [-EXTREME, EXTREME]]))
    chosen = np.sort(rng.choice(len(alphabet), size, replace=False))
    return SymbolTable(alphabet[chosen], random_weights(rng, size))


def random_rows(rng: np.random.Generator, count: int, size: int) -> F64:
    """(count, size) frequencies - 1: anything from even to all of it at one symbol."""
    weights = np.exp2(rng.uniform(0, 16, (count, size))).astype(np.int64)
    weights[rng.random(count) < 0.3] = 0
    weights[np.arange(count), rng.integers(0, size, count)] += 1 << int(rng.integers(0, 24))
    tables = [FrequencyTable.from_weights(row).frequencies - 1 for row in weights]
    return np.array(tables, np.float64).reshape(count, size)


def frequency_rows(logits: F32) -> F64:
    """The frequencies that NumPy computes from a copy of the logits."""
    return NUMPY.frequency_rows(logits.copy(), NUMPY.constant(exp2_table()))


def library() -> Any:
    """The compiled library."""
    return load()


def both_decoders(data: bytes) -> tuple[KernelRansDecoder, PureRansDecoder]:
    """The compiled decoder of a stream, and the definition."""
    return KernelRansDecoder(library(), data), PureRansDecoder(data)


def check_same_state(compiled: KernelRansDecoder, pure: PureRansDecoder) -> None:
    """Whatever comes next, they go on alike."""
    assert (compiled._rans.state, compiled._rans.left) == (pure._state, len(pure._words))


def outcome(act: Callable[[], Any]) -> Any:
    """The result of `act`, or all that is reported about its refusal."""
    try:
        return act()
    except ScarError as error:
        return type(error), error.refusal, error.message, error.offset, error.field


def both(act: Callable[[Engine], Any]) -> tuple[Any, Any]:
    """Outcomes of `act` with the kernel and with the definition."""
    return outcome(lambda: act(KernelEngine(load()))), outcome(lambda: act(NUMPY_ENGINE))


def same(a: Any, b: Any) -> bool:
    """Equal, arrays also in shape and type."""
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and a.dtype == b.dtype and np.array_equal(a, b)
    if isinstance(a, list | tuple):
        return type(a) is type(b) and len(a) == len(b) and all(map(same, a, b))
    return bool(a == b)
