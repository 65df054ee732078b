"""The stand-in for constriction decodes what the package decodes."""

from __future__ import annotations

import importlib.util
from types import ModuleType

import constriction
import numpy as np
import pytest

from conformance.portability.machines import STANDIN


@pytest.fixture(scope="module")
def standin() -> ModuleType:
    spec = importlib.util.spec_from_file_location("standin", STANDIN / "constriction" / "__init__.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("seed", range(5))
def test_symbols_and_end_state_are_those_of_the_package(standin: ModuleType, seed: int) -> None:
    """One model for a group, and a row of weights for each symbol, in one stream; also one cut short."""
    rng = np.random.default_rng(seed)
    size = int(rng.integers(2, 40))
    tables = rng.multinomial((1 << 24) - size, rng.dirichlet(np.ones(size), 8)).astype(np.float64)
    symbols = rng.integers(0, size, (2, 8)).astype(np.int32)
    coder = constriction.stream.stack.AnsCoder()
    family = constriction.stream.model.Categorical
    coder.encode_reverse(symbols[1], family(perfect=False), tables)
    coder.encode_reverse(symbols[0], family(tables[0], perfect=False))
    words = coder.get_compressed()
    for given in (words, words[1:]):
        found = []
        for package in (constriction, standin):
            kind, decoder = package.stream.model.Categorical, package.stream.stack.AnsCoder(given)
            first = decoder.decode(kind(tables[0], perfect=False), 8)
            second = decoder.decode(kind(perfect=False), tables)
            found.append((first.tolist(), second.tolist(), bool(decoder.is_empty())))
        assert found[0] == found[1]
        if given is words:
            assert found[0] == (symbols[0].tolist(), symbols[1].tolist(), True)
