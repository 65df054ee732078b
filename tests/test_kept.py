"""A value kept with an object is one thing, whoever asks for it and however many ask at once."""

import copy
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from scarfmt.container.schema import Stream
from scarfmt.entropy.keys import StepKey
from scarfmt.entropy.symbol_tables import StaticTables
from scarfmt.kept import Keeper
from scarfmt.kernel.packed_tables import PackedStaticTables, PackedTables
from tests.kernel.samples import needs_kernel

THREADS = 4


def together(ask):
    """The results of `ask` in threads that ask at the same time."""
    with ThreadPoolExecutor(THREADS) as pool:
        return [asked.result() for asked in [pool.submit(ask) for _ in range(THREADS)]]


def test_what_is_made_once_is_given_again():
    keeper, made = Keeper(), []

    def make(_, number, *, name=""):
        made.append((number, name))
        return object()

    first = keeper.kept(make, 1)
    assert keeper.kept(make, 1) is first
    assert keeper.kept(make, 2) is not first
    assert keeper.kept(make, 1, name="x") is not first
    assert made == [(1, ""), (2, ""), (1, "x")]


def test_a_copy_starts_with_nothing_kept():
    """A kept value may hold addresses of the original's arrays."""
    keeper = Keeper()

    def make(_):
        return object()

    first = keeper.kept(make)
    assert copy.copy(keeper).kept(make) is not first


def test_threads_that_make_the_same_at_once_are_given_one_thing():
    """A second one in its place would free what somebody has the address of."""
    keeper, both = Keeper(), threading.Barrier(THREADS)

    def make(_):
        both.wait(30)
        return object()

    found = together(lambda: keeper.kept(make))
    assert len({id(one) for one in found}) == 1
    assert keeper.kept(make) is found[0]


@needs_kernel
@pytest.mark.parametrize("ask", ["step", "steps"])
def test_threads_that_pack_the_same_tables_at_once_are_given_one(ask, monkeypatch):
    """Of two copies, one would know what was read, and the other would be asked whether all tables were used."""
    packed, both, real = PackedStaticTables(StaticTables({})), threading.Barrier(THREADS), PackedTables.of

    def slowly(*arguments):
        made = real(*arguments)
        both.wait(30)
        return made

    monkeypatch.setattr(PackedTables, "of", slowly)
    if ask == "step":
        found = together(lambda: packed.step(StepKey(Stream.OPACITY, (0,), 1)))
    else:
        found = together(lambda: packed.steps(Stream.OPACITY, 1, range(1, 2)))
    assert len({id(one) for one in found}) == 1
