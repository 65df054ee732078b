"""The questions about each vector, which answers pass, and the text of a failure (conformance/PROTOCOL.md)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from scarfmt_conformance.protocol import STAGES, Capabilities, Fault, Question, Refusal, Reply, Values
from scarfmt_conformance.runner import FAILED, PASSED, SKIPPED, Options, Result, Run, run

from scarfmt.errors import InvalidInput
from tests.conformance.suite.conftest import Json, SuiteWriter, array, only, score, stages

CLAIMS = Capabilities("stub", frozenset({"0.1"}), frozenset({"explicit", "anchor"}), STAGES)
OBJECT = Values({"metadata": {"metadata": {"a": 1}}})


class Stub:
    """A decoder in this process that writes down what it is asked."""

    def __init__(self, answer: Callable[[Question], Any], claims: Any = CLAIMS):
        self.killed = False
        self.asked: list[tuple[int, str]] = []
        self.files: list[Path] = []
        self._answer, self._claims = answer, claims

    def ask(self, question: Question) -> Reply:
        if question.stage == "capabilities":
            return Reply(self._claims, 0.0, "")
        self.asked.append((question.layers, question.stage))
        self.files.append(question.file)
        return Reply(self._answer(question), 0.0, "said this")

    def close(self) -> None:
        """Nothing runs."""

    def kill(self) -> None:
        self.killed = True


def ask(suite: SuiteWriter, stub: Stub, options: Options | None = None) -> Run:
    loaded = suite.load()
    return run(loaded, loaded.vectors, lambda: stub, options or Options())


def claiming(*names: str, **changed: Any) -> Capabilities:
    fields = {"decoder": "stub", "versions": frozenset({"0.1"}), "profiles": CLAIMS.profiles, **changed}
    return Capabilities(stages=names, **fields)


def two_layers() -> list[Json]:
    last = stages(position=array()) | {"container": {"container": {"header": {"minor": "1"}}}}
    return [{"layer": 1, "stages": stages(position=array())}, {"layer": 2, "stages": last}]


def right(_question: Question) -> Values:
    return Values(two_layers()[1]["stages"])


# ------------------------------------------------------------------------------------------------ decoded


def test_each_layer_is_asked_for_and_metadata_where_pinned(suite: SuiteWriter) -> None:
    suite.decoded("valid/plain", layers=two_layers())
    suite.decoded("valid/with", layers=two_layers(), metadata={"a": 1})
    stub = Stub(lambda question: OBJECT if question.stage == "metadata" else right(question))
    assert ask(suite, stub).passed
    assert stub.asked == [(1, "all"), (2, "all")] * 2 + [(0, "metadata")]


@pytest.mark.parametrize(
    ("offset", "outcome"), [(None, PASSED), (100, PASSED), (236, PASSED), (99, FAILED), (237, FAILED), (-1, FAILED)]
)
def test_an_offset_that_is_given_must_lie_in_the_fault(suite: SuiteWriter, offset: int | None, outcome: str) -> None:
    """R-12.1-2: none is as good as a right one, a wrong one misleads."""
    suite.refused("invalid/o", refusal="layer-bytes", offsets=[100, 236])
    (result,) = ask(suite, Stub(lambda _question: Refusal("layer-bytes", "", offset))).results
    assert result.outcome == outcome
    assert outcome == PASSED or (result.failure is not None and result.failure.kind == "offset")


def test_the_camera_of_the_vector_is_asked_for(suite: SuiteWriter) -> None:
    """Data of the vector, not of the protocol: expect.json has it."""
    suite.decoded("valid/seen", layers=two_layers(), camera=[1, -2.5, 0])
    suite.decoded("valid/unseen", layers=two_layers())
    cameras = []

    def note(question: Question) -> Values:
        cameras.append(question.camera)
        return right(question)

    ask(suite, Stub(note))
    assert cameras == [(1.0, -2.5, 0.0)] * 2 + [None] * 2


def test_streaming_information_is_asked_for_where_pinned(suite: SuiteWriter) -> None:
    """By itself, and compared with what is pinned."""
    suite.decoded("valid/told", layers=two_layers(), streaming={"layers": 1})
    for told, outcome in (({"layers": 1}, PASSED), ({"layers": 2}, FAILED), (None, FAILED)):
        answered = Values({"streaming": {"streaming": told}})
        stub = Stub(lambda question, of=answered: of if question.stage == "streaming" else right(question))
        assert only(ask(suite, stub)).outcome == outcome
        assert stub.asked[-1] == (0, "streaming")


def test_the_last_layer_alone_can_be_asked_for(suite: SuiteWriter) -> None:
    suite.decoded("valid/a", layers=two_layers())
    stub = Stub(right)
    assert ask(suite, stub, Options(last_layer=True)).passed
    assert stub.asked == [(2, "all")]


def test_the_first_stage_that_differs_is_named_with_all_others(suite: SuiteWriter) -> None:
    wrong = stages(position=array("cd" * 32)) | {"container": {"container": {"header": {"minor": "2"}}}}
    suite.decoded("valid/a", layers=two_layers())
    result = only(ask(suite, Stub(lambda question: Values(wrong) if question.layers == 2 else right(question))))
    assert result.failure is not None
    assert result.failure.kind == "values"
    assert result.failure.message == "stage container, field header.minor: differs"
    assert result.failure.layer == 2
    assert result.failure.errors == "said this"
    assert [found.stage for found in result.failure.differences] == ["container", "values"]
    assert result.stages == {"container": False, "values": False}


def test_a_vector_ends_with_its_first_failure(suite: SuiteWriter) -> None:
    """Sixteen layers must not take sixteen time limits."""
    suite.decoded("valid/a", layers=two_layers(), metadata=None)
    stub = Stub(lambda _question: Fault("timeout", "no answer"))
    result = only(ask(suite, stub))
    assert (result.outcome, result.questions, stub.asked) == (FAILED, 1, [(1, "all")])


# ------------------------------------------------------------------------------------------------ refused


@pytest.mark.parametrize(
    ("answer", "kind"),
    [
        (Refusal("bad-table", ""), None),
        (Refusal("bad-trit", "why"), "refusal"),
        (Values({}), "accepted"),
        (CLAIMS, "answer"),
        (Fault("status", "exit status 1"), "status"),
    ],
)
def test_only_the_id_of_a_refusal_counts(suite: SuiteWriter, answer: Any, kind: str | None) -> None:
    suite.refused("invalid/a")
    failure = only(ask(suite, Stub(lambda _question: answer))).failure
    assert (failure and failure.kind) == kind
    if failure is not None and kind != "status":
        assert failure.expected == "bad-table"


# ------------------------------------------------------------------------------------------------ either


@pytest.mark.parametrize(
    ("answer", "pinned", "outcome"),
    [
        (Refusal("limit-tiles", ""), True, PASSED),
        (Refusal("entry-count", ""), False, PASSED),
        (Refusal("bad-table", ""), True, FAILED),
        (right(Question(Path(), 0, "all")), True, PASSED),
        (right(Question(Path(), 0, "all")), False, FAILED),
        (Values({"values": {"arrays": {}}}), True, FAILED),
    ],
)
def test_either_a_refusal_or_the_values(suite: SuiteWriter, answer: Any, pinned: bool, outcome: str) -> None:
    """The values only where they are pinned."""
    layers = {"layers": two_layers()} if pinned else {}
    suite.add("either/a", {}, result="either", refusals=["limit-tiles", "entry-count"], **layers)
    stub = Stub(lambda _question: answer)
    assert only(ask(suite, stub)).outcome == outcome
    assert stub.asked == [(0, "all")]


@pytest.mark.parametrize(
    ("answer", "pinned", "outcome"),
    [
        (OBJECT, True, PASSED),
        (OBJECT, False, FAILED),
        (Refusal("bad-metadata", ""), True, PASSED),
        (Refusal("bad-metadata", ""), False, PASSED),
        (Refusal("bad-table", ""), True, FAILED),
        (Values({"metadata": {"metadata": [1]}}), True, FAILED),
        (Values({}), True, FAILED),
    ],
)
def test_metadata_that_parsers_differ_about(suite: SuiteWriter, answer: Any, pinned: bool, outcome: str) -> None:
    """Whatever object where the rest is sound, but no crash; a decode that does not ask for it is not disturbed."""
    layers = {"layers": two_layers()} if pinned else {}
    suite.add("either/m", {}, result="either", refusals=["bad-metadata"], **layers)
    stub = Stub(lambda question: answer if question.stage == "metadata" else right(question))
    assert only(ask(suite, stub)).outcome == outcome
    assert stub.asked == ([(0, "all")] if pinned else []) + [(0, "metadata")]


# ------------------------------------------------------------------------------------------------ what is claimed


@pytest.mark.parametrize(
    ("claimed", "asked"),
    [
        (("container",), {"invalid/container"}),
        (("container", "metadata"), {"invalid/container", "invalid/metadata"}),
        (("container", "streaming"), {"invalid/container", "invalid/streaming"}),
        (("models",), {"invalid/container", "invalid/models"}),
        (("context",), {"invalid/container", "invalid/models", "invalid/tiles"}),
        (("values", "metadata"), {"invalid/container", "invalid/models", "invalid/tiles", "invalid/metadata"}),
        ((), set()),
    ],
)
def test_a_decoder_is_held_to_the_refusals_of_the_stages_it_claims(
    suite: SuiteWriter, claimed: tuple[str, ...], asked: set[str]
) -> None:
    for stage in ("container", "models", "tiles", "metadata", "streaming"):
        suite.refused(f"invalid/{stage}", stage=stage)
    results = ask(suite, Stub(lambda _question: Refusal("bad-table", ""), claiming(*claimed))).results
    assert {result.vector.id for result in results if result.outcome == PASSED} == asked
    assert all(result.outcome in (PASSED, SKIPPED) for result in results)


def test_stages_selected_are_as_if_no_others_were_claimed(suite: SuiteWriter) -> None:
    suite.decoded("valid/a", layers=two_layers())
    suite.decoded("valid/b")
    suite.refused("invalid/tiles")
    stub = Stub(right)
    first, second, third = ask(suite, stub, Options(stages=("container",))).results
    assert (first.outcome, first.stages) == (PASSED, {"container": True})
    assert (second.outcome, second.reason) == (SKIPPED, "nothing pinned is of a stage claimed")
    assert third.outcome == SKIPPED
    assert stub.asked == [(2, "all")]


@pytest.mark.parametrize(
    ("claims", "reason"),
    [
        (claiming("values", profiles=frozenset({"anchor"})), "the explicit profile is not claimed"),
        (claiming("values", versions=frozenset({"0.2"})), "version 0.1 is not claimed"),
    ],
)
def test_other_profiles_and_versions_are_skipped(suite: SuiteWriter, claims: Capabilities, reason: str) -> None:
    """A run in which everything was skipped has not passed."""
    suite.decoded("valid/a")
    results = ask(suite, Stub(right, claims))
    assert (only(results).outcome, only(results).reason) == (SKIPPED, reason)
    assert not results.passed


def test_a_file_of_no_profile_is_for_all(suite: SuiteWriter) -> None:
    suite.refused("invalid/a", profile=None)
    stub = Stub(lambda _question: Refusal("bad-table", ""), claiming("values", profiles=frozenset()))
    assert ask(suite, stub).passed


@pytest.mark.parametrize("answer", [Fault("timeout", "no answer"), Refusal("bad-table", ""), Values({})])
def test_without_capabilities_nothing_is_asked(suite: SuiteWriter, answer: Any) -> None:
    suite.decoded("valid/a")
    stub = Stub(right, answer)
    results = ask(suite, stub)
    assert results.handshake is not None
    assert results.handshake.message.startswith("capabilities: ")
    assert not results.passed
    assert stub.asked == []


# ------------------------------------------------------------------------------------------------ files


def test_a_file_is_extended_by_zeros_without_filling_the_disk(suite: SuiteWriter, ask_by_session: bool) -> None:
    """A decoder sees the length; the copy is gone afterwards."""
    folder = suite.refused("invalid/long", {"answers": {"all 0": "size"}}, refusal="size-5000000", extend_to=5_000_000)
    assert only(score(suite, ask_by_session)).outcome == PASSED
    assert (folder / "input.scar").stat().st_size < 1000
    stub = Stub(lambda question: Refusal(f"size-{question.file.stat().st_size}", ""))
    assert ask(suite, stub).passed
    assert not stub.files[0].exists()


def test_a_file_that_cannot_be_that_long_is_skipped(suite: SuiteWriter) -> None:
    """2^62 bytes are beyond any file system: no fault of the decoder."""
    suite.refused("invalid/huge", extend_to=1 << 62)
    result = only(ask(suite, Stub(right)))
    assert result.outcome == SKIPPED
    assert "no file of" in result.reason


def test_a_damaged_suite_is_found_before_anything_is_asked(suite: SuiteWriter) -> None:
    suite.decoded("valid/a")
    folder = suite.decoded("valid/b")
    loaded = suite.load()
    (folder / "input.scar").write_bytes(b"other")
    stub = Stub(right)
    with pytest.raises(InvalidInput, match="valid/b"):
        run(loaded, loaded.vectors, lambda: stub, Options())
    assert stub.asked == []


# ------------------------------------------------------------------------------------------------ together


@pytest.mark.parametrize("jobs", [1, 3, 50])
def test_results_are_in_the_order_of_the_vectors(suite: SuiteWriter, ask_by_session: bool, jobs: int) -> None:
    """However many decoders work, each vector is asked about once."""
    ids = [f"valid/v{number}" for number in range(7)]
    for id_ in ids:
        suite.decoded(id_, {"misbehave": "crash"} if id_ == "valid/v3" else None)
    results = score(suite, ask_by_session, Options(jobs=jobs)).results
    assert [result.vector.id for result in results] == ids
    assert [result.outcome == FAILED for result in results] == [id_ == "valid/v3" for id_ in ids]


@pytest.mark.parametrize("error", [InvalidInput("input-suite", "broken"), KeyboardInterrupt()])
def test_an_error_in_one_thread_ends_all(suite: SuiteWriter, error: BaseException) -> None:
    """The error is raised, not swallowed, and no decoder is left at work."""
    for number in range(20):
        suite.decoded(f"valid/v{number}")
    loaded = suite.load()
    stubs: list[Stub] = []

    def report(result: Result) -> None:
        if result.vector.id == "valid/v1":
            raise error

    def connect() -> Stub:
        stubs.append(Stub(right))
        return stubs[-1]

    with pytest.raises(type(error)):
        run(loaded, loaded.vectors, connect, Options(jobs=4), report)
    assert [stub.killed for stub in stubs] == [True] * 4
