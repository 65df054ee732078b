"""The questions about each vector, and the judgement of the answers (conformance/PROTOCOL.md)."""

from __future__ import annotations

import shutil
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from queue import SimpleQueue

from scarfmt_conformance.compare import Difference, annotation_difference, differences, pinned_stages
from scarfmt_conformance.manifest import REFUSAL_STAGES, Expectation, Layer, Suite, Vector, check_file, load_expectation
from scarfmt_conformance.protocol import (
    ALL,
    ANNOTATIONS,
    CAPABILITIES,
    METADATA,
    STAGES,
    Answer,
    Capabilities,
    Decoder,
    Fault,
    Question,
    Refusal,
    Reply,
    Values,
)

PASSED, FAILED, SKIPPED = "passed", "failed", "skipped"
_WORKED = "worked"

Connect = Callable[[], Decoder]


@dataclass(frozen=True)
class Options:
    """The selection of questions about a vector.

    Attributes:
        stages: to compare, as if the decoder claimed no others.
        last_layer: only the last layer pinned, instead of each.
        jobs: decoders asked at the same time.
    """

    stages: tuple[str, ...] = STAGES
    last_layer: bool = False
    jobs: int = 1


@dataclass(frozen=True)
class Failure:
    """Why a vector failed.

    Attributes:
        kind: ``values`` (they differ), ``refused`` (though valid), ``accepted`` (though to be refused),
            ``refusal`` (another id), ``offset`` (the right id at the wrong byte), or that of a :class:`Fault`.
        message: one line.
        layer: the layer asked for; 0 for all.
        differences: of the first stage that differs first; empty unless values differ.
        expected: what would have been right, where that is not in `differences`.
        got: what came instead.
        errors: end of the decoder's standard error.
    """

    kind: str
    message: str
    layer: int = 0
    differences: tuple[Difference, ...] = ()
    expected: str = ""
    got: str = ""
    errors: str = ""


@dataclass
class Result:
    """The outcome of a vector.

    Attributes:
        vector: it.
        purpose: what it is there for.
        outcome: ``passed``, ``failed`` or ``skipped``.
        reason: why it was skipped.
        failure: why it failed.
        questions: how many were asked.
        seconds: for all of them.
        stages: stage -> whether it agreed, of those compared.
    """

    vector: Vector
    purpose: str = ""
    outcome: str = PASSED
    reason: str = ""
    failure: Failure | None = None
    questions: int = 0
    seconds: float = 0.0
    stages: dict[str, bool] = field(default_factory=dict)


@dataclass
class Run:
    """A decoder's score.

    Attributes:
        suite: what it was asked.
        capabilities: what it claims; None if it did not say.
        handshake: why it did not.
        results: in the order of the vectors.
        seconds: altogether.
    """

    suite: Suite
    capabilities: Capabilities | None = None
    handshake: Failure | None = None
    results: list[Result] = field(default_factory=list)
    seconds: float = 0.0

    def counts(self) -> Counter[str]:
        """Vectors by outcome."""
        return Counter(result.outcome for result in self.results)

    @property
    def passed(self) -> bool:
        """Whether nothing failed and something passed."""
        counts = self.counts()
        return self.handshake is None and not counts[FAILED] and counts[PASSED] > 0


Seen = dict[str, bool]
"""Stage -> whether it agreed, of those compared."""


@dataclass(frozen=True)
class _Task:
    """A question, and which answers are right.

    Attributes:
        refusal: names the refusals that are right; None if none is.
        compare: the differences of values, the stages compared added; None if values are wrong.
    """

    layers: int
    stage: str
    refusal: Expectation | None
    compare: Callable[[Values, Seen], list[Difference]] | None
    camera: tuple[float, ...] | None = None

    def judge(self, answer: Answer, seen: Seen) -> Failure | None:
        """Why an answer is wrong."""
        if isinstance(answer, Values) and self.compare is not None:
            found = self.compare(answer, seen)
            return _values_failure(found) if found else None
        if self.refusal is not None:
            return _judge_refusal(self.refusal, answer)
        if isinstance(answer, Refusal):
            return Failure("refused", "a file to be decoded is refused", expected="values", got=_refusal_text(answer))
        return Failure("answer", "the answer is not to the question asked", expected="values")


def run(
    suite: Suite,
    vectors: Sequence[Vector],
    connect: Connect,
    options: Options,
    report: Callable[[Result], None] = lambda _result: None,
) -> Run:
    """Ask a decoder about vectors.

    Args:
        vectors: at least one; their files are checked first.
        connect: makes a decoder; called once per job.
        report: called with every result, in the order of time, from several threads but one at a time.

    Raises:
        InvalidInput: ``input-suite``: a file of the suite is missing or damaged.
    """
    for vector in vectors:
        check_file(vector)
    start = time.monotonic()
    decoders = [connect() for _ in range(min(options.jobs, len(vectors)))]
    score = Run(suite)
    try:
        score.capabilities, score.handshake = _shake_hands(suite, vectors, decoders[0])
        if score.capabilities is not None:
            with tempfile.TemporaryDirectory(prefix="scar-conformance-") as scratch:
                examine = partial(_examine, suite, score.capabilities, options, Path(scratch))
                score.results = _examine_all(vectors, decoders, examine, report)
    finally:
        for decoder in decoders:
            decoder.close()
    score.seconds = time.monotonic() - start
    return score


def _shake_hands(
    suite: Suite, vectors: Sequence[Vector], decoder: Decoder
) -> tuple[Capabilities | None, Failure | None]:
    worked = next((vector for vector in suite.vectors if vector.id == _WORKED), vectors[0])
    reply = decoder.ask(Question(worked.file.resolve(), 0, CAPABILITIES))
    if isinstance(reply.answer, Capabilities):
        return reply.answer, None
    fault = reply.answer if isinstance(reply.answer, Fault) else Fault("answer", "answered something else")
    return None, Failure(fault.kind, f"{CAPABILITIES}: {fault.message}", errors=reply.errors)


def _examine_all(
    vectors: Sequence[Vector],
    decoders: Sequence[Decoder],
    examine: Callable[[Decoder, Vector], Result],
    report: Callable[[Result], None],
) -> list[Result]:
    """The results in the order of the vectors, a thread a decoder; an exception, an interrupt included, ends all."""
    free: SimpleQueue[Decoder] = SimpleQueue()
    for decoder in decoders:
        free.put(decoder)
    reporting = threading.Lock()

    def examine_one(vector: Vector) -> Result:
        decoder = free.get()
        try:
            result = examine(decoder, vector)
        finally:
            free.put(decoder)
        with reporting:
            report(result)
        return result

    with ThreadPoolExecutor(len(decoders), thread_name_prefix="conformance") as pool:
        try:
            return list(pool.map(examine_one, vectors))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for decoder in decoders:
                decoder.kill()
            raise


def _examine(
    suite: Suite, claims: Capabilities, options: Options, scratch: Path, decoder: Decoder, vector: Vector
) -> Result:
    """Ask all questions of a vector, up to the first that fails."""
    expectation = load_expectation(vector)
    result = Result(vector, expectation.purpose)
    stages = [stage for stage in claims.stages if stage in options.stages]
    result.reason = _not_claimed(suite, vector, claims)
    tasks = [] if result.reason else list(_tasks(vector, expectation, stages, options.last_layer))
    if not tasks:
        result.outcome, result.reason = SKIPPED, result.reason or "nothing pinned is of a stage claimed"
        return result
    file = _extend(vector, expectation.extend_to, scratch)
    if file is None:
        result.outcome, result.reason = SKIPPED, f"no file of {expectation.extend_to:,} bytes can be made here"
        return result
    for task in tasks:
        reply = decoder.ask(Question(file, task.layers, task.stage, task.camera))
        result.questions += 1
        result.seconds += reply.seconds
        result.failure = _judge(reply, task, result.stages)
        if result.failure is not None:
            result.outcome = FAILED
            break
    if file != vector.file:
        file.unlink()
    return result


def _extend(vector: Vector, length: int, scratch: Path) -> Path | None:
    """The file to ask about: the vector's, or a sparse copy with zeros after it; None if that cannot be made."""
    if length <= vector.bytes:
        return vector.file
    path = scratch / f"{vector.id.replace('/', '-')}.scar"
    shutil.copyfile(vector.file, path)
    try:
        with path.open("r+b") as stream:
            stream.truncate(length)
    except OSError:
        path.unlink()
        return None
    return path


def _not_claimed(suite: Suite, vector: Vector, claims: Capabilities) -> str:
    if suite.bitstream not in claims.versions:
        return f"version {suite.bitstream} is not claimed"
    if vector.profile is not None and vector.profile not in claims.profiles:
        return f"the {vector.profile} profile is not claimed"
    return ""


def _judge(reply: Reply, task: _Task, compared: dict[str, bool]) -> Failure | None:
    if isinstance(reply.answer, Fault):
        return Failure(reply.answer.kind, reply.answer.message, task.layers, errors=reply.errors)
    failure = task.judge(reply.answer, compared)
    return failure and replace(failure, layer=task.layers, errors=reply.errors)


# ------------------------------------------------------------------------------------------------ questions


def refusals_held_to(stages: Sequence[str]) -> int:
    """How many of `REFUSAL_STAGES`, annotations aside, a decoder that claims these stages has to refuse at."""
    deepest = max((STAGES.index(stage) for stage in stages if stage not in ANNOTATIONS), default=-1)
    return min(deepest + 1, len(REFUSAL_STAGES) - len(ANNOTATIONS))


def _tasks(vector: Vector, expectation: Expectation, stages: list[str], last_layer: bool) -> Iterator[_Task]:
    """The questions of a vector that such a decoder is to be asked; none if it is not."""
    folder, refusal = vector.expect.parent, None if vector.result == "decoded" else expectation
    if refusal is not None and expectation.stage in ANNOTATIONS:
        if vector.result == "either" and expectation.layers and pinned_stages(expectation.layers[-1].stages, stages):
            yield _Task(0, ALL, refusal, partial(_compare, expectation.layers[-1], stages, folder))
        if expectation.stage in stages:
            whatever = _compare_object if vector.result == "either" and expectation.layers else None
            yield _Task(0, expectation.stage, refusal, whatever)
        return
    if refusal is not None:
        last = expectation.layers[-1] if expectation.layers and vector.result == "either" else None
        held = REFUSAL_STAGES.index(expectation.stage) < refusals_held_to(stages)
        if held or (last is not None and pinned_stages(last.stages, stages)):
            yield _Task(0, ALL, refusal, partial(_compare, last, stages, folder) if last else None)
        return
    for layer in expectation.layers[-1:] if last_layer else expectation.layers:
        if pinned_stages(layer.stages, stages):
            yield _Task(layer.layer, ALL, None, partial(_compare, layer, stages, folder), expectation.camera)
    for stage, pinned in expectation.annotations.items():
        if stage in stages:
            yield _Task(0, stage, None, partial(_compare_annotation, stage, pinned))


# ------------------------------------------------------------------------------------------------ judges


def _compare(layer: Layer, stages: list[str], folder: Path, answer: Values, seen: Seen) -> list[Difference]:
    found: list[Difference] = []
    for stage in pinned_stages(layer.stages, stages):
        different = differences(stage, layer.stages[stage], answer.stages.get(stage), folder)
        seen[stage] = seen.get(stage, True) and not different
        found += different
    return found


def _compare_annotation(stage: str, pinned: object, answer: Values, seen: Seen) -> list[Difference]:
    difference = annotation_difference(stage, pinned, answer.stages.get(stage))
    seen[stage] = difference is None
    return [difference] if difference else []


def _compare_object(answer: Values, _seen: Seen) -> list[Difference]:
    """Of metadata that parsers differ about: whatever object is right."""
    found = answer.stages.get(METADATA)
    if isinstance(found, dict) and isinstance(found.get(METADATA), dict):
        return []
    return [Difference(METADATA, "", "the stage is not an object with an object metadata")]


def _values_failure(found: Sequence[Difference]) -> Failure:
    first = found[0]
    subject = f", {'field' if first.stage == 'container' else 'array'} {first.array}" if first.array else ""
    return Failure("values", f"stage {first.stage}{subject}: {first.message}", differences=tuple(found))


def _refusal_text(refusal: Refusal) -> str:
    return f"{refusal.id}: {refusal.message}" if refusal.message else refusal.id


def _judge_refusal(expectation: Expectation, answer: Answer) -> Failure | None:
    right = " or ".join(expectation.refusals)
    if isinstance(answer, Values):
        return Failure("accepted", "a file to be refused is decoded", expected=right, got="values")
    if not isinstance(answer, Refusal):
        return Failure("answer", "the answer is not to the question asked", expected=right)
    if answer.id not in expectation.refusals:
        return Failure("refusal", "refused with another id", expected=right, got=_refusal_text(answer))
    # An offset that points elsewhere than at the fault; a decoder need not give one (SPEC R-12.1-1, R-12.1-2).
    if expectation.offsets is None or answer.offset is None:
        return None
    first, past = expectation.offsets
    if first <= answer.offset <= past:
        return None
    right = f"an offset of {first}..{past}, or none"
    return Failure("offset", "refused at another byte", expected=right, got=_refusal_text(answer))
