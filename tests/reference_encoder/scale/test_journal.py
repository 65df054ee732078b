"""What has been done for a plan is not done again; what was done for another plan is not touched."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from reference_encoder.options import EncodeOptions
from reference_encoder.scale.executor import workers
from reference_encoder.scale.journal import Journal, begin, described, plan_of
from reference_encoder.scale.work import Work
from scarfmt.errors import InvalidInput
from scarfmt.render.camera import look_at
from tests.reference_encoder.scale import tasks


def test_equal_values_are_described_alike_and_others_are_not() -> None:
    """Cameras hold arrays; metadata come in any order."""

    def options(far: float, metadata: dict[str, int]) -> object:
        camera = look_at(np.array([far, 0.0, 0.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 64, 48, 1.0)
        return described(EncodeOptions(cameras=[camera], metadata=metadata))

    assert options(1, {"a": 1, "b": 2}) == options(1, {"b": 2, "a": 1})
    assert options(1, {}) != options(2, {})
    assert described(0.1) != described(np.float32(0.1))


def test_a_directory_is_gone_on_with_only_if_asked_for_and_for_the_same_plan(tmp_path: Path) -> None:
    work = Work(str(tmp_path / "work"))
    plan = plan_of(options=EncodeOptions(), sizes={"range": 5})
    begin(work, plan, resume=True)
    begin(work, plan, resume=True)
    with pytest.raises(InvalidInput, match="--resume") as caught:
        begin(work, plan, resume=False)
    assert caught.value.refusal == "work-exists"
    for other in (plan_of(options=EncodeOptions(seed=1), sizes={"range": 5}), plan_of(options=EncodeOptions())):
        with pytest.raises(InvalidInput, match=r"differs in (options|sizes)") as caught:
            begin(work, other, resume=True)
        assert caught.value.refusal == "work-plan"


def test_tasks_with_a_mark_are_not_done_again(tmp_path: Path) -> None:
    work = Work(str(tmp_path / "work"))
    calls = [(str(tmp_path), number) for number in range(5)]
    with workers() as made:
        journal = Journal(work, made)
        first = journal.results("step", tasks.count_calls, calls)
        assert [next(first) for _ in range(3)] == [(0, 100, True), (1, 101, True), (2, 102, True)]
        first.close()
        assert set(journal.results("step", tasks.count_calls, calls)) == {
            *((number, number + 100, False) for number in range(3)),
            *((number, number + 100, True) for number in (3, 4)),
        }
        assert list(journal.results("other", tasks.square, [(2,)])) == [(0, 4, True)]
    traces = {path.name: path.read_text() for path in tmp_path.glob("calls-*")}
    assert all(re.fullmatch("x", trace) for trace in traces.values())
    assert len(traces) == 5
