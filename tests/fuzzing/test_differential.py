"""Two implementations, one answer: textbook rANS, and the readable decoder on sound and on damaged files."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scarfmt_conformance.reference import answers
from scarfmt_conformance.reference.answers import Manner

from conformance.decoders.python import answers as readable
from conformance.decoders.python.fields import Rans, Refused, Table, cumulative
from conformance.writer.file import write_file
from fuzz.corpus import corpus
from fuzz.target import decode_by
from fuzz.testing.mutators import mutate
from fuzz.testing.neural_scenes import neural_scene
from fuzz.testing.scenes import random_scene
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.schema import Profile
from scarfmt.entropy.rans import FrequencyTable, RansDecoder
from scarfmt.errors import ScarError

_HASH = re.compile("[0-9a-f]{64}")


@settings(deadline=None, max_examples=200)
@given(
    st.lists(st.integers(0, 2**32 - 1), max_size=12),
    st.lists(st.tuples(st.lists(st.integers(1, 2**24 - 1), min_size=1, max_size=40), st.integers(0, 20)), max_size=6),
)
def test_textbook_rans_reads_the_same(words: list[int], groups: list[tuple[list[int], int]]) -> None:
    """Any words, also those no encoder writes: the same symbols, and the same end."""
    data = b"".join(word.to_bytes(4, "little") for word in words)
    tables = {key: Table(range(len(w)), cumulative(w)) for key, (w, _) in enumerate(groups)}
    try:
        slow, fast = Rans(data, tables), RansDecoder(data)
    except (Refused, ScarError):
        with pytest.raises(Refused):
            Rans(data, tables)
        with pytest.raises(ScarError):
            RansDecoder(data)
        return
    for key, (weights, count) in enumerate(groups):
        table = FrequencyTable.from_weights(np.array(weights))
        assert slow.read(key, count) == fast.decode(table, count).tolist()
    assert _ends(slow.seal) == _ends(fast.finish)


@settings(deadline=None, max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 10_000), st.sampled_from(list(Profile)), st.sampled_from([random_scene, neural_scene]))
def test_the_readable_decoder_reads_scenes_the_same(
    tmp_path: Path, seed: int, profile: Profile, make: Callable[..., QuantisedScene]
) -> None:
    """Every exact array of every stage, after every layer: a writer and two readers that share no code."""
    data = write_file(make(seed, profile, anchors=30, layers=1 + seed % 3, tiles=2))
    path = tmp_path / "scene.scar"
    path.write_bytes(data)
    for layer in range(1, 2 + seed % 3):
        ours = answers.answer(str(path), layer, "all", Manner())
        theirs = readable.answer(data, layer, "all")
        for stage in readable.EXACT:
            assert _hashes(ours, stage) == _hashes(theirs, stage)


def _hashes(answer: dict[str, Any], stage: str) -> dict[str, tuple[str, list[int], str]]:
    arrays = answer["stages"][stage]["arrays"]
    return {name: (array["dtype"], array["shape"], array["sha256"]) for name, array in arrays.items()}


def _ends(finish: Any) -> bool:
    try:
        finish()
    except (Refused, ScarError):
        return False
    return True


def test_the_readable_decoder_refuses_damaged_files_alike() -> None:
    """Both refuse with the same id, or both accept."""
    files = corpus()
    datas = [file.data for file in files]
    differ = []
    for seed in range(150):
        mutant = mutate(datas[7 * seed % len(datas)], seed, datas)
        wanted = decode_by(mutant.data, native=False)
        wanted = "" if _HASH.fullmatch(wanted) else wanted
        found = readable.answer(mutant.data, 0, "integers").get("refused", "")
        if wanted != found:
            differ.append((files[7 * seed % len(files)].name, seed, mutant.operators, wanted, found))
    assert differ == []
