"""Errors carry what a program matches on and what a person needs."""

from __future__ import annotations

import copy
import pickle

import pytest

from scarfmt import errors
from scarfmt.errors import (
    DeniedFile,
    FileTaken,
    InputWarning,
    InvalidInput,
    LimitExceeded,
    LossWarning,
    Malformed,
    MissingFile,
    ScarError,
    Truncated,
    Unsupported,
)

FILES = [MissingFile, DeniedFile, FileTaken]
CLASSES = [ScarError, Unsupported, Malformed, Truncated, LimitExceeded, InvalidInput, *FILES]


@pytest.mark.parametrize("kind", CLASSES)
def test_message_names_refusal_place_and_reason(kind: type[ScarError]) -> None:
    """Refusal id first, then the message, then field and byte where known."""
    assert str(kind("some-id", "what is wrong")) == "some-id: what is wrong"
    assert str(kind("some-id", "wrong", field="layers[0]")) == "some-id: wrong (layers[0])"
    assert str(kind("some-id", "wrong", offset=0)) == "some-id: wrong (byte 0)"
    error = kind("some-id", "wrong", offset=7, field="x")
    assert str(error) == "some-id: wrong (x, byte 7)"
    assert (error.refusal, error.message, error.offset, error.field) == ("some-id", "wrong", 7, "x")


def test_the_hierarchy_sorts_by_what_to_do() -> None:
    """A cut file is damage; a bad argument is also a ValueError; no class is another's cousin by accident."""
    assert issubclass(Truncated, Malformed)
    assert issubclass(InvalidInput, ValueError)
    assert not any(issubclass(kind, Malformed) for kind in (Unsupported, LimitExceeded, InvalidInput))
    public = {value for value in vars(errors).values() if isinstance(value, type) and issubclass(value, Exception)}
    assert public - {InputWarning, LossWarning} == set(CLASSES)
    assert issubclass(LossWarning, InputWarning)


@pytest.mark.parametrize("kind", CLASSES)
def test_errors_survive_copying_between_processes(kind: type[ScarError]) -> None:
    """A worker process hands its error over unchanged."""
    error = kind("some-id", "wrong", offset=7, field="x")
    for twin in (pickle.loads(pickle.dumps(error)), copy.copy(error)):
        assert type(twin) is kind
        assert str(twin) == str(error)
        assert (twin.refusal, twin.offset, twin.field) == ("some-id", 7, "x")


def test_text_of_a_file_can_neither_act_on_a_terminal_nor_fill_it() -> None:
    error = InvalidInput("some-id", "a\x1b[31m\ud800\n" + "x" * 5000, field="y\0" * 500)
    assert str(error).isprintable()
    assert str(error).startswith("some-id: a\\x1b[31m\\ud800\\n")
    assert len(str(error)) < 2000
