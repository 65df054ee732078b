"""Sub-streams written and read by the compiled coders: the bytes and values of the definition (SPEC §8)."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.arrays import F32, Ints
from scarfmt.blocks.tables import fit_table
from scarfmt.coding.engine import NUMPY_ENGINE, Engine
from scarfmt.entropy.emitters import SymbolCounter
from scarfmt.entropy.recorded import SymbolRecorder
from scarfmt.kernel.engine import KernelEngine
from tests.kernel.samples import SEEDS, frequency_rows, library, needs_kernel, outcome
from tests.samples.codec_samples import STEP, many_groups

pytestmark = needs_kernel


@settings(deadline=None, max_examples=60)
@given(st.lists(many_groups(), max_size=3))
def test_writers_and_recorders_of_many_groups(calls: list[tuple[Ints, Ints]]) -> None:
    """Groups give the same bytes at once and later; either reader finds the values in their places."""
    kernel, written = KernelEngine(library()), list[bytes]()
    for engine in (kernel, NUMPY_ENGINE):
        counter = SymbolCounter()
        recorder = SymbolRecorder(counter, engine.symbol_writer)
        for kinds, values in calls:
            recorder.emit_grouped(STEP, kinds, values)
        recorded = recorder.settled()
        known = {key: fit_table(*histogram) for key, histogram in counter.histograms().items()}
        writer = engine.symbol_writer(known)
        for kinds, values in calls:
            writer.emit_grouped(STEP, kinds, values)
        written += [writer.finish(), recorded.code(known, engine.symbol_writer)]
    assert len(set(written)) == 1
    for engine in (kernel, NUMPY_ENGINE):
        reader = engine.symbol_reader(written[0], known)
        for kinds, values in calls:
            assert reader.read_grouped(STEP, kinds).tolist() == values.tolist()
        reader.finish()


def modelled(engine: Engine, logits: F32, symbols: Ints, at_hand: bool) -> bytes:
    """The stream of a writer for symbols of logits, given the logits or only their rows."""
    writer = engine.symbol_writer({})
    writer.emit_logits(logits.copy() if at_hand else None, lambda: frequency_rows(logits), symbols)
    return writer.finish()


@settings(deadline=None, max_examples=60)
@given(SEEDS, st.integers(1, 40), st.integers(1, 70))
def test_logits_and_their_rows_are_one_stream(seed: int, size: int, count: int) -> None:
    """If another library than NumPy holds the logits, the rows computed from them are coded."""
    rng = np.random.default_rng(seed)
    logits, symbols = rng.integers(-600, 600, (size, count)).astype(np.float32), rng.integers(0, size, count)
    kernel = KernelEngine(library())
    data = modelled(NUMPY_ENGINE, logits, symbols, True)
    assert data == modelled(kernel, logits, symbols, True) == modelled(kernel, logits, symbols, False)
    for engine in (kernel, NUMPY_ENGINE):
        for given_logits in (logits, None):
            reader = engine.symbol_reader(data, {})
            found = reader.read_logits(given_logits, lambda: frequency_rows(logits), 1)
            reader.finish()
            assert found.tolist() == symbols.tolist()
            assert reader.modelled == count


def test_tables_used_are_those_that_read_a_symbol() -> None:
    """A table that exists but was not needed is not among them."""
    counter, engine = SymbolCounter(), KernelEngine(library())
    kinds, values = np.array([0, 300, 300]), np.array([4, 5, 6])
    counter.emit_grouped(STEP, kinds, values)
    known = {key: fit_table(*histogram) for key, histogram in counter.histograms().items()}
    writer = engine.symbol_writer(known)
    writer.emit_grouped(STEP, kinds[1:], values[1:])
    reader = engine.symbol_reader(writer.finish(), known)
    reader.read_grouped(STEP, kinds[1:])
    tables = reader._tables
    assert outcome(lambda: engine.tables_read(tables)) == {STEP.table(300)}  # type: ignore[arg-type]
