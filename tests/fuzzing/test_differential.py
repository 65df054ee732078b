"""Two implementations, one answer: textbook rANS, the second decoder, torch, and JavaScript."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scarfmt_conformance.reference import answers
from scarfmt_conformance.reference.answers import Manner

from conformance.decoders.python import answers as minimal_answers
from conformance.decoders.python.fields import Rans, Refused, Table, cumulative
from conformance.surgery.files import vector_file
from fuzz.corpus import corpus
from fuzz.target import decoded
from fuzz.testing.mutators import mutate
from fuzz.testing.neural_scenes import neural_scene
from fuzz.testing.scenes import random_scene
from reference_decoder.decode import decode
from scarfmt.coding.engine import NUMPY_ENGINE
from scarfmt.coding.writer import QuantisedScene, write_scene
from scarfmt.container.schema import Profile
from scarfmt.entropy.rans import FrequencyTable, RansDecoder
from scarfmt.errors import ScarError

CLI = Path(__file__).resolve().parents[2] / "conformance" / "decoders" / "js" / "cli.js"


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
def test_the_second_decoder_reads_scenes_the_same(
    tmp_path: Path, seed: int, profile: Profile, make: Callable[..., QuantisedScene]
) -> None:
    """Every exact array of every stage, after every layer: a writer and two readers that share no code."""
    data = vector_file(make(seed, profile, anchors=30, layers=1 + seed % 3, tiles=2))
    path = tmp_path / "scene.scar"
    path.write_bytes(data)
    for layer in range(1, 2 + seed % 3):
        ours = answers.answer(str(path), layer, "all", Manner(NUMPY_ENGINE))
        theirs = minimal_answers.answer(data, layer, "all")
        for stage in minimal_answers.EXACT:
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


@pytest.mark.parametrize("profile", Profile)
def test_torch_decodes_the_same(profile: Profile) -> None:
    """Bit for bit, whatever does the network's arithmetic."""
    pytest.importorskip("torch")
    for seed in range(4):
        data = write_scene(neural_scene(seed, profile, anchors=40, layers=2, tiles=2))
        plain, torch = decode(data), decode(data, backend="torch")
        assert all(map(np.array_equal, plain.arrays(), torch.arrays()))


@contextmanager
def session() -> Iterator[Any]:
    """Questions to the JavaScript decoder: file, then its answer."""
    node = shutil.which("node")
    if node is None or not CLI.exists():
        pytest.skip("needs node and the JavaScript decoder")
    process = subprocess.Popen([node, str(CLI), "--session"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def ask(path: Path) -> dict[str, Any]:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(json.dumps({"file": str(path), "layers": 0, "stage": "all"}) + "\n")
        process.stdin.flush()
        line = process.stdout.readline()
        assert line, "the decoder died"
        answer: dict[str, Any] = json.loads(line)
        return answer

    try:
        yield ask
    finally:
        process.kill()
        process.communicate()


def test_javascript_agrees_on_damaged_files(tmp_path: Path) -> None:
    """Both refuse with the same id or both accept, except for the limits that a decoder need not have (SPEC §13.2)."""
    files = corpus()
    datas = [file.data for file in files]
    differ = []
    with session() as ask:
        for seed in range(150):
            mutant = mutate(datas[seed % len(datas)], seed, datas)
            path = tmp_path / "mutant.scar"
            path.write_bytes(mutant.data)
            wanted, found = _refusal_of_decoding(mutant.data), ask(path).get("refused", "")
            if wanted != found and not wanted.startswith("limit-") and not found.startswith("limit-"):
                differ.append((files[seed % len(files)].name, seed, mutant.operators, wanted, found))
    assert differ == []


def _refusal_of_decoding(data: bytes) -> str:
    """Without the metadata, at which a decoder does not look."""
    refusal = decoded(data)
    return "" if refusal in ("bad-metadata", "limit-metadata") else refusal
