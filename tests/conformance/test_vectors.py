"""Every vector, once for each decoder, against the validator and the editor: one test a class names what fails."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scarfmt_conformance.archive import CHECKOUT, expectation, names, read
from scarfmt_conformance.manifest import Suite, open_suite
from scarfmt_conformance.protocol import Question, Reply, parse
from scarfmt_conformance.reference.answers import Manner
from scarfmt_conformance.reference.answers import answer as reference_answer
from scarfmt_conformance.runner import FAILED, Options, run

from conformance.decoders.python import answers as readable
from conformance.decoders.python.decoder import Decoder
from conformance.decoders.python.front import Limits
from conformance.decoders.python.work import Work
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.work import compute_work
from scarfmt.container.source import BytesSource, open_source
from scarfmt.limits import FORMAT_LIMITS
from scarfmt.native.binding import absence
from scarfmt.tools.truncate import truncate
from scarfmt.tools.validate import validate
from tests.conformance.vector_files import vector_file

CLASSES = {"valid": ("worked", "valid/*")}
CLASSES |= {name: (f"{name}/*",) for name in ("edge", "invalid", "truncated", "either")}
UNLIMITED = Limits(False, *[1 << 62] * (len(Limits._fields) - 1))
ENGINES = ("numpy", "native", "readable")

Answer = Callable[[Question], dict[str, Any]]


class InProcess:
    """A decoder of this process, asked as one of another would be."""

    def __init__(self, answer: Answer) -> None:
        self._answer = answer

    def ask(self, question: Question) -> Reply:
        return Reply(parse(json.dumps(self._answer(question)).encode()), 0.0, "")

    def close(self) -> None:
        """Nothing runs."""

    kill = close


def answerer(engine: str) -> Answer:
    """How an engine answers; the compiled one skips the test where it is missing."""
    if engine == "readable":
        return lambda asked: readable.answer_file(asked.file, asked.layers, asked.stage)
    if engine == "native" and absence() is not None:
        pytest.skip(f"no C library: {absence()}")
    manner = Manner(native=engine == "native")
    return lambda asked: reference_answer(
        str(asked.file), asked.layers, asked.stage, replace(manner, camera=asked.camera)
    )


@pytest.fixture(scope="module")
def suite() -> Iterator[Suite]:
    """The suite of this checkout."""
    with open_suite(CHECKOUT) as opened:
        yield opened


@pytest.mark.parametrize("class_", CLASSES)
@pytest.mark.parametrize("engine", ENGINES)
def test_a_decoder_agrees_with_the_vectors(engine: str, class_: str, suite: Suite) -> None:
    """Every stage of every layer, annotations, and the id and place of refusals (R-12.1-2)."""
    answer = answerer(engine)
    asked = [vector for vector in suite.vectors if vector.class_ == class_]
    score = run(suite, asked, lambda: InProcess(answer), Options())
    assert score.handshake is None
    assert {result.vector.id: result.failure for result in score.results if result.outcome == FAILED} == {}
    assert score.passed


def test_the_reference_refuses_a_byte_beyond_the_limit_of_work() -> None:
    """Other readers may have raised it; with the numbers of SPEC §13.2 a term that is not counted shows here."""
    manner = Manner()
    found = {name: reference_answer(str(vector_file(name)), 0, "all", manner) for name in names("either/work-*")}
    assert found
    assert {name for name, answer in found.items() if answer.get("refused") != "limit-work"} == set()


@pytest.mark.parametrize("class_", CLASSES)
def test_the_work_of_the_reference_is_that_of_the_specification(class_: str) -> None:
    """work(k) of SPEC §13.2, computed from what the readable decoder reads."""
    wrong = []
    for name in names(*CLASSES[class_]):
        for layer in expectation(name).get("layers", []):
            with open_source(str(vector_file(name))) as source:
                reader = SceneReader(source, limits=FORMAT_LIMITS)
                models = reader.models(layer["layer"])
                declared = reader.extent(layer["layer"], np.arange(reader.header.tile_count))
                readable_file = Decoder(read(name), layer["layer"], UNLIMITED)
                if compute_work(models, *declared) != Work(readable_file).total():
                    wrong.append((name, layer["layer"]))
    assert not wrong


@pytest.mark.parametrize("class_", CLASSES)
def test_validate_agrees_with_the_vectors(class_: str) -> None:
    """Valid vectors keep every rule, (V) rules too; of others the rule broken is found, perhaps after others."""
    wrong = {}
    for name in names(*CLASSES[class_]):
        with open_source(str(vector_file(name))) as source:
            errors = {finding.refusal for finding in validate(source).findings if finding.severity == "error"}
        if not _validated(expectation(name), errors):
            wrong[name] = errors
    assert wrong == {}


def _validated(expect: dict[str, Any], errors: set[str]) -> bool:
    """Whether the validator may find these errors and no others."""
    if expect["result"] == "refused":
        return expect["refusal"] in errors
    if expect["result"] == "either":
        return errors <= set(expect["refusals"])
    last = expect["layers"][-1]
    declared = int(last["stages"]["container"]["container"]["header"]["layer_count"])
    # Of some, layers that no decoder is asked for have faults.
    return bool(errors) == (last["layer"] < declared)


def test_truncated_vectors_are_what_an_editor_makes() -> None:
    """Byte for byte (SPEC §14)."""
    cut = {name: expect for name in names("truncated/*") if "from" in (expect := expectation(name))}
    assert cut
    for name, expect in cut.items():
        assert truncate(BytesSource(read(expect["from"])), expect["to_layer"]) == read(name), name
