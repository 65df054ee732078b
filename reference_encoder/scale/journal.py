"""The journal of a work directory, so that nothing is done twice: a plan, and a mark for each task that ended.

A mark is the task's result. It is written last, by whoever did the task: what it stands for is whole. All tasks are
functions of the plan and their number, so that a mark of the same plan is as good as doing the task again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, TypeVar

import numpy as np

from reference_encoder.scale.executor import Workers
from reference_encoder.scale.work import Work
from scarfmt.errors import InvalidInput

PLAN = "plan.json"

T = TypeVar("T")


def described(value: Any) -> Any:
    """A value as JSON can hold it: the same for equal values, with a digest in place of an array."""
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: described(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, np.ndarray):
        return [str(value.dtype), list(value.shape), hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()]
    if isinstance(value, Mapping):
        return {str(key): described(value[key]) for key in sorted(value, key=str)}
    if isinstance(value, list | tuple):
        return [described(one) for one in value]
    if value is None or isinstance(value, bool | int | str):
        return value
    return repr(float(value))


def plan_of(**parts: Any) -> dict[str, Any]:
    """A plan: everything that the bytes of the result depend on.

    Args:
        parts: options, source, sizes and version of this package, by name.
    """
    return {"numpy": np.__version__, **{name: described(value) for name, value in parts.items()}}


def begin(work: Work, plan: Mapping[str, Any], resume: bool) -> None:
    """Take a work directory for a plan.

    Args:
        work: where nothing has been done, or some of the same plan.
        plan: of :func:`plan_of`.
        resume: whether to go on with what has been done.

    Raises:
        InvalidInput: ``work-exists``: something was done there and `resume` is not set; ``work-plan``: it was of
            another plan; the message says what differs.
    """
    if PLAN not in work.names():
        with work.write(PLAN) as stream:
            stream.write(json.dumps(plan, indent=1).encode())
        return
    if not resume:
        message = f"{work.place} holds an encoding: --resume goes on with it; or give another directory to --work"
        raise InvalidInput("work-exists", message)
    kept = json.loads(work.read(PLAN))
    differs = sorted(name for name in {*kept, *plan} if kept.get(name) != plan.get(name))
    if differs:
        message = f"{work.place} holds work of another plan, which differs in {', '.join(differs)};"
        raise InvalidInput("work-plan", f"{message} give the command it began with, or another directory to --work")


@dataclass(frozen=True)
class Journal:
    """Does tasks of which there is no mark.

    Attributes:
        work: where marks are.
        workers: who does them.
    """

    work: Work
    workers: Workers

    def results(
        self, step: str, function: Callable[..., T], tasks: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, T, bool]]:
        """(Number, result, whether it was done now) of every task of a step, first of those that had been done.

        Args:
            step: what its marks are called.
            function: of a module; its arguments are those of a task.
            tasks: arguments of each.

        Raises:
            Whatever a task raises; ``work-lost`` where its workers die.
        """
        folder = f"done/{step}"
        self.work.tidy(folder)
        known = self.work.names(folder)
        left = []
        for number in range(len(tasks)):
            if _mark(number) in known:
                yield number, self.work.get(f"{folder}/{_mark(number)}"), False
            else:
                left.append(number)
        calls = [(self.work, f"{folder}/{_mark(number)}", function, tasks[number]) for number in left]
        for place, found in self.workers.results(marked, calls):
            yield left[place], found, True


def _mark(number: int) -> str:
    return f"{number:06}"


def marked(work: Work, name: str, function: Callable[..., T], arguments: tuple[Any, ...]) -> T:
    """Do a task, and leave its result as the mark that it ended."""
    result = function(*arguments)
    work.put(name, result)
    return result
