"""Tasks for tests of executors: functions of a module, as worker processes need them."""

from __future__ import annotations

import os
from pathlib import Path

from scarfmt.errors import InvalidInput


def square(number: int) -> int:
    return number * number


def fail(number: int) -> int:
    if number == 3:
        raise InvalidInput("input-empty", "three")
    return number


def die_once(folder: str, number: int, deadly: int) -> int:
    """Ends its process without a word where it is task `deadly`, the first time."""
    mark = Path(folder) / str(number)
    if number == deadly and not mark.exists():
        mark.touch()
        os._exit(1)
    return number * number


def die(number: int) -> int:
    os._exit(number)


def count_calls(folder: str, number: int) -> int:
    """Leaves a trace of each call."""
    with (Path(folder) / f"calls-{number}").open("a") as stream:
        stream.write("x")
    return number + 100
