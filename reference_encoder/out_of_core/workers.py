"""Running tasks in this process, in processes, or on a Dask cluster; a task that has left its result is not done again.

A task is a function of a module with small arguments and a small result that can be pickled; what is large goes through
the work directory. A task whose worker dies is tried again: tasks are pure, so that it may have been half done.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from reference_encoder.out_of_core.work_dir import WorkDir, file_name
from scarfmt.errors import InvalidInput, missing_package

TRIES = 4
"""How often a task is begun whose workers die: one that takes more memory than there is would die for ever."""
AHEAD = 2
"""Tasks handed to an executor for each worker: one to work on, and one to go on with."""
CONNECT_SECONDS = 30
"""Time a scheduler has to answer."""

T = TypeVar("T")


@dataclass
class Workers:
    """Places where tasks are done.

    Attributes:
        make: opens an executor, also one in place of a broken one; None to do each task in this process.
        count: tasks that are done side by side.
    """

    make: Callable[[], Executor] | None = None
    count: Callable[[], int] = lambda: 1
    _executor: Executor | None = None

    def results(self, function: Callable[..., T], tasks: Sequence[tuple[Any, ...]]) -> Iterator[tuple[int, T]]:
        """(Number of the task, its result) of every task, in the order in which they end.

        Args:
            function: of a module.

        Raises:
            InvalidInput: ``work-lost``: the workers of a task died `TRIES` times.
            Whatever a task raises; others that were begun are then left alone.
        """
        if self.make is None:
            yield from ((number, function(*arguments)) for number, arguments in enumerate(tasks))
            return
        left, tries = list(reversed(range(len(tasks)))), [0] * len(tasks)
        running: dict[Future[T], int] = {}
        try:
            while left or running:
                self._fill(function, tasks, left, running)
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    number = running.pop(future)
                    try:
                        found = future.result()
                    except Exception as error:
                        tries[number] += 1
                        _check_death(error, tries[number], f"{function.__name__} {number}")
                        left.append(number)
                    else:
                        yield number, found
        finally:
            for future in running:
                future.cancel()

    def _fill(
        self,
        function: Callable[..., T],
        tasks: Sequence[tuple[Any, ...]],
        left: list[int],
        running: dict[Future[T], int],
    ) -> None:
        assert self.make is not None
        while left and len(running) < AHEAD * max(self.count(), 1):
            self._executor = self._executor or self.make()
            try:
                running[self._executor.submit(function, *tasks[left[-1]])] = left[-1]
            except BrokenExecutor:
                # Which task broke it is not known: those that run come back with the same error, and are counted.
                if running:
                    return
                self.close()
            else:
                left.pop()

    def close(self) -> None:
        """Let the workers go."""
        if self._executor is not None:
            self._executor.shutdown(wait=True)
        self._executor = None

    def results_once(
        self, work: WorkDir, step: str, function: Callable[..., T], tasks: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, T]]:
        """(Number, result) of every task of a step, first of those that had been done.

        Args:
            work: holds a file for each result, which the worker writes last.
            step: name of its folder.
            function, tasks: as of :meth:`results`, which says what is raised.
        """
        folder = f"done/{step}"
        known = work.names(folder)
        left = []
        for number in range(len(tasks)):
            if f"{number:06}" in known:
                yield number, work.get(file_name(folder, number))
            else:
                left.append(number)
        calls = [(work, file_name(folder, number), function, tasks[number]) for number in left]
        for place, found in self.results(do_and_keep, calls):
            yield left[place], found


def do_and_keep(work: WorkDir, name: str, function: Callable[..., T], arguments: tuple[Any, ...]) -> T:
    """Do a task, and keep its result as the sign that it ended."""
    result = function(*arguments)
    work.put(name, result)
    return result


def _check_death(error: Exception, tries: int, task: str) -> None:
    """Raise the error of a task that failed, but not that of a worker that has gone, unless that was its last try."""
    if not isinstance(error, BrokenExecutor) and type(error).__name__ not in ("KilledWorker", "CancelledError"):
        raise error
    if tries == TRIES:
        message = (
            f"workers died {tries} times doing {task}: most likely for want of memory;"
            " fewer --workers or a smaller --range-size need less"
        )
        raise InvalidInput("work-lost", message) from error


@contextmanager
def open_workers(count: int = 1, cluster: str | None = None) -> Iterator[Workers]:
    """Workers, let go at the end.

    Args:
        count: of processes; 1 for this process alone.
        cluster: address of a Dask scheduler, whose workers are used instead; each needs this package, the source and
            the work directory.

    Raises:
        InvalidInput: ``input-dependency`` where Dask is missing; ``input-cluster`` where nothing answers there.
    """
    client = None if cluster is None else _connect(cluster)
    if client is not None:
        # Dask itself begins a task again whose worker has gone. Workers come and go.
        made = Workers(partial(client.get_executor, pure=False), lambda: sum(client.nthreads().values()))
    else:
        made = Workers() if count == 1 else Workers(partial(_start_processes, count), lambda: count)
    try:
        yield made
    finally:
        made.close()
        if client is not None:
            client.close()


def _start_processes(count: int) -> ProcessPoolExecutor:
    methods = multiprocessing.get_all_start_methods()
    # A fork of a process with threads may hang; a server forks workers that have begun nothing.
    method = "forkserver" if "forkserver" in methods else "spawn"
    return ProcessPoolExecutor(count, multiprocessing.get_context(method), initializer=_use_one_thread)


def _use_one_thread() -> None:
    """Processes work side by side: threads inside products would wait for each other."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def _connect(address: str) -> Any:
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise missing_package("distributed", "cluster") from error
    try:
        connect: Any = Client
        return connect(address, timeout=CONNECT_SECONDS)
    except (OSError, ValueError) as error:
        raise InvalidInput("input-cluster", f"no Dask scheduler answers at {address}: {error}") from error
