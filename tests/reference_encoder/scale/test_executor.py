"""Tasks are done wherever they run; one whose worker dies is done again, one that fails is not."""

from __future__ import annotations

from pathlib import Path

import pytest

from reference_encoder.scale.executor import TRIES, SerialExecutor, workers
from scarfmt.errors import InvalidInput
from tests.reference_encoder.scale import tasks


@pytest.mark.parametrize("count", [1, 2])
def test_every_task_is_done_once(count: int) -> None:
    with workers(count) as made:
        found = dict(made.results(tasks.square, [(number,) for number in range(20)]))
        assert found == {number: number * number for number in range(20)}
        assert dict(made.results(tasks.square, [])) == {}


@pytest.mark.parametrize("count", [1, 2])
def test_what_a_task_refuses_is_refused(count: int) -> None:
    """With its id, also from another process."""
    with workers(count) as made, pytest.raises(InvalidInput) as caught:
        list(made.results(tasks.fail, [(number,) for number in range(20)]))
    assert caught.value.refusal == "input-empty"


def test_a_worker_that_dies_is_replaced_and_its_task_done_again(tmp_path: Path) -> None:
    with workers(2) as made:
        found = dict(made.results(tasks.die_once, [(str(tmp_path), number, 4) for number in range(12)]))
        assert found == {number: number * number for number in range(12)}
        assert dict(made.results(tasks.square, [(3,)])) == {0: 9}


def test_a_task_that_always_kills_its_worker_ends_the_work() -> None:
    with workers(2) as made, pytest.raises(InvalidInput, match=f"died {TRIES} times doing die 0.*memory") as caught:
        list(made.results(tasks.die, [(1,)]))
    assert caught.value.refusal == "work-lost"


def test_interrupts_are_not_kept_for_later() -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        SerialExecutor().submit(interrupt)


def test_a_cluster_that_does_not_answer_is_told() -> None:
    pytest.importorskip("distributed", reason="needs Dask: pip install 'scarfmt[cluster]'")
    with pytest.raises(InvalidInput) as caught, workers(cluster="tcp//nowhere"):
        pass
    assert caught.value.refusal == "input-cluster"
