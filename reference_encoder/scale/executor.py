"""Running tasks on any :class:`concurrent.futures.Executor`: in this process, in processes, on a Dask cluster.

A task is a function of a module with small arguments and a small result that can be pickled; what is large goes through
the work directory. A task whose worker dies is tried again: tasks are pure, so that it may have been half done.
"""

from __future__ import annotations

import multiprocessing
import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, ParamSpec, TypeVar

from scarfmt.errors import InvalidInput, missing_package

TRIES = 4
"""How often a task is begun whose workers die: one that takes more memory than there is would die for ever."""
AHEAD = 2
"""Tasks handed to an executor for each worker: one to work on, and one to go on with."""

CONNECT_SECONDS = 30
"""Time a scheduler has to answer."""

P = ParamSpec("P")
T = TypeVar("T")


class SerialExecutor(Executor):
    """Does each task at once, in this process."""

    def submit(self, function: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """The result of a call, which is over when this returns. What it raises other than errors is raised here."""
        future: Future[T] = Future()
        try:
            future.set_result(function(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


@dataclass
class Workers:
    """Places where tasks are done.

    Attributes:
        make: opens an executor, also one in place of a broken one.
        count: tasks that are done side by side.
        executor: the one in use.
    """

    make: Callable[[], Executor]
    count: Callable[[], int]
    executor: Executor

    def results(self, function: Callable[..., T], tasks: Sequence[tuple[Any, ...]]) -> Iterator[tuple[int, T]]:
        """(Number of the task, its result) of every task, in the order in which they end.

        Args:
            function: of a module.
            tasks: arguments of each call.

        Raises:
            InvalidInput: ``work-lost``: the workers of a task died `TRIES` times.
            Whatever a task raises; others that were begun are then left alone.
        """
        left = deque(range(len(tasks)))
        tries = [0] * len(tasks)
        under_way: dict[Future[T], int] = {}
        try:
            while left or under_way:
                self._fill(function, tasks, left, under_way, tries)
                for future in wait(under_way, return_when=FIRST_COMPLETED).done:
                    number = under_way.pop(future)
                    try:
                        found = future.result()
                    except Exception as error:
                        if not _worker_died(error):
                            raise
                        _check_tries(tries[number], number, function)
                        left.appendleft(number)
                        continue
                    yield number, found
        finally:
            for future in under_way:
                future.cancel()

    def _fill(
        self,
        function: Callable[..., T],
        tasks: Sequence[tuple[Any, ...]],
        left: deque[int],
        under_way: dict[Future[T], int],
        tries: list[int],
    ) -> None:
        while left and len(under_way) < AHEAD * max(self.count(), 1):
            number = left.popleft()
            tries[number] += 1
            try:
                future = self.executor.submit(function, *tasks[number])
            except BrokenExecutor:
                # Which task broke it is not known: those under way come back with the same error, and are counted.
                tries[number] -= 1
                left.appendleft(number)
                if under_way:
                    return
                self.executor.shutdown(wait=False)
                self.executor = self.make()
                continue
            under_way[future] = number
            if isinstance(self.executor, SerialExecutor):
                return


def _worker_died(error: Exception) -> bool:
    """Tell an error of a worker that has gone from one of a task that failed."""
    return isinstance(error, BrokenExecutor) or type(error).__name__ in ("KilledWorker", "CancelledError")


def _check_tries(tries: int, number: int, function: Callable[..., Any]) -> None:
    if tries >= TRIES:
        message = (
            f"workers died {tries} times doing {function.__name__} {number}: most likely for want of memory;"
            " fewer --workers or a smaller --range-size need less"
        )
        raise InvalidInput("work-lost", message)


@contextmanager
def workers(count: int = 1, cluster: str | None = None) -> Iterator[Workers]:
    """Workers, let go at the end.

    Args:
        count: of processes; 1 for this process alone.
        cluster: address of a Dask scheduler, whose workers are used instead; each needs this package, the source and
            the work directory.

    Raises:
        InvalidInput: ``input-dependency`` where Dask is missing; ``input-cluster`` where nothing answers there.
    """
    if cluster is not None:
        with _dask(cluster) as found:
            yield found
        return
    make: Callable[[], Executor] = SerialExecutor if count == 1 else lambda: _processes(count)
    made = Workers(make, lambda: count, make())
    try:
        yield made
    finally:
        made.executor.shutdown(wait=True, cancel_futures=True)


def _processes(count: int) -> ProcessPoolExecutor:
    methods = multiprocessing.get_all_start_methods()
    # A fork of a process with threads may hang; a server forks workers that have begun nothing.
    method = "forkserver" if "forkserver" in methods else "spawn"
    return ProcessPoolExecutor(count, multiprocessing.get_context(method), initializer=_one_thread)


def _one_thread() -> None:
    """Processes are what is worked in side by side: threads inside products would wait for each other."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


@contextmanager
def _dask(address: str) -> Iterator[Workers]:
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise missing_package("distributed", "cluster") from error
    try:
        connect: Any = Client
        client = connect(address, timeout=CONNECT_SECONDS)
    except (OSError, ValueError) as error:
        raise InvalidInput("input-cluster", f"no Dask scheduler answers at {address}: {error}") from error
    try:
        # Dask itself begins a task again whose worker has gone; tasks that fail are not begun again.
        make = partial(client.get_executor, pure=False)
        yield Workers(make, lambda: _threads(client), make())
    finally:
        client.close()


def _threads(client: Any) -> int:
    """Tasks that the workers of a cluster do side by side now: workers come and go."""
    return sum(client.nthreads().values())
