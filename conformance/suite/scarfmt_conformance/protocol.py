"""Questions, answers, and how an answer is read from what a decoder printed (conformance/PROTOCOL.md).

A decoder's output is a stranger's: nothing here raises because of it, a :class:`Fault` says what is wrong instead.
"""

from __future__ import annotations

import json
import re
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from scarfmt.errors import InvalidInput

PROTOCOL = "scar-conformance 2"
CAPABILITIES = "capabilities"
ALL = "all"
METADATA, STREAMING = "metadata", "streaming"
ANNOTATIONS = (METADATA, STREAMING)
"""Stages of what decodes nothing: a decode must not look at it, so each is asked for by itself."""
STAGES = (
    "container",
    "models",
    "context",
    "frequencies",
    "indices",
    "integers",
    "sums",
    "values",
    "activated",
    *ANNOTATIONS,
)
"""In the order in which a decoder comes to them."""

SHOWN_CHARACTERS = 300
_PLACES = {"file": "file", "layers": "layers", "k": "layers", "stage": "stage", "s": "stage", "camera": "camera"}
_PLACE = re.compile(r"\{(" + "|".join(_PLACES) + r")\}")


@dataclass(frozen=True)
class Question:
    """A question about one file.

    Attributes:
        file: absolute path.
        layers: layer to decode to, from 1; 0 for all.
        stage: one of `STAGES`, ``all`` or ``capabilities``.
        camera: centre of the camera, world units, for which Gaussians are asked; None where none are pinned.
    """

    file: Path
    layers: int
    stage: str
    camera: tuple[float, ...] | None = None

    def line(self) -> bytes:
        """The question as a session reads it."""
        asked = {"file": str(self.file), "layers": self.layers, "stage": self.stage}
        seen = {} if self.camera is None else {"camera": self.camera}
        return json.dumps({**asked, **seen}).encode() + b"\n"


@dataclass(frozen=True)
class Values:
    """An answer: what was decoded, unchecked JSON by stage."""

    stages: dict[str, Any]


@dataclass(frozen=True)
class Refusal:
    """An answer: the file is refused.

    Attributes:
        id: refusal id of SPEC §12.1, printable.
        message: what the decoder says about it, with the byte offset, printable; may be empty.
        offset: byte of the file at which the fault is, where the decoder says.
    """

    id: str
    message: str
    offset: int | None = None


@dataclass(frozen=True)
class Capabilities:
    """An answer: what the decoder claims.

    Attributes:
        decoder: its name and version, printable.
        versions: of the format, such as ``0.1``.
        profiles: ``explicit``, ``anchor``.
        stages: those of `STAGES` that it answers, in that order.
    """

    decoder: str
    versions: frozenset[str]
    profiles: frozenset[str]
    stages: tuple[str, ...]


@dataclass(frozen=True)
class Fault:
    """No answer.

    Attributes:
        kind: ``answer`` (not the JSON object asked for), ``status``, ``timeout`` or ``output`` (too much).
        message: for people.
    """

    kind: str
    message: str


Answer = Values | Refusal | Capabilities


@dataclass(frozen=True)
class Reply:
    """The outcome of a question.

    Attributes:
        answer: the answer, or why there is none.
        seconds: until it was there.
        errors: end of what it wrote to standard error, printable.
    """

    answer: Answer | Fault
    seconds: float
    errors: str


class Decoder(Protocol):
    """Whatever can be asked, one question at a time."""

    def ask(self, question: Question) -> Reply:
        """The answer to a question, or a fault; raises nothing because of the decoder."""

    def close(self) -> None:
        """End its processes."""

    def kill(self) -> None:
        """End them from another thread, whatever they do, and start no others."""


def printable(text: str, limit: int = SHOWN_CHARACTERS, lines: bool = False) -> str:
    """A decoder's text, fit for terminals, XML and JSON: no control characters, no lone surrogates, not too long.

    Args:
        limit: characters kept, from the start.
        lines: keep line ends.
    """
    kept = text[:limit] + ("..." if len(text) > limit else "")
    parts = kept.split("\n") if lines else [kept]
    return "\n".join(_printable_line(part.replace("\t", " ").rstrip("\r")) for part in parts)


def _printable_line(text: str) -> str:
    return "".join(c if c.isprintable() else "\ufffd" for c in text)


def template(text: str) -> list[str]:
    """The words of a command with ``{file}``, ``{layers}`` and ``{stage}`` in it; ``{camera}`` may be.

    Raises:
        InvalidInput: ``input-options``: a quote is not closed, or a place is missing.
    """
    words = command(text)
    found = {_PLACES[name] for word in words for name in _PLACE.findall(word)}
    missing = [f"{{{name}}}" for name in ("file", "layers", "stage") if name not in found]
    if missing:
        raise InvalidInput("input-options", f"the decoder's command has no {', '.join(missing)}", field="--decoder")
    return words


def command(text: str) -> list[str]:
    """The words of a command, split as a POSIX shell would.

    Raises:
        InvalidInput: ``input-options``: it is empty, or a quote is not closed.
    """
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise InvalidInput("input-options", f"the decoder's command cannot be split: {error}") from error
    if not words:
        raise InvalidInput("input-options", "the decoder's command is empty")
    return words


def fill(words: list[str], question: Question) -> list[str]:
    """The words of a template with a question put in; the camera is ``X,Y,Z``, or empty without one."""
    camera = ",".join(map(repr, question.camera or ()))
    values = {"file": str(question.file), "layers": str(question.layers), "stage": question.stage, "camera": camera}
    return [_PLACE.sub(lambda match: values[_PLACES[match[1]]], word) for word in words]


def parse(data: bytes) -> Answer | Fault:
    """The answer a decoder printed.

    Args:
        data: all of its output, or one line of it.
    """
    if not data.strip():
        return Fault("answer", "printed nothing")
    try:
        value = json.loads(data.decode("utf-8"))
    except UnicodeDecodeError as error:
        return Fault("answer", f"the output is not UTF-8 at byte {error.start}: {_excerpt(data)}")
    except (ValueError, RecursionError, MemoryError) as error:
        return Fault("answer", f"the output is not one JSON value ({printable(str(error), 120)}): {_excerpt(data)}")
    kinds = {"stages": _values, "refused": _refusal, "capabilities": _capabilities}
    found = [name for name in kinds if isinstance(value, dict) and name in value]
    if len(found) != 1:
        return Fault("answer", f"the output is not an object with stages, refused or capabilities: {_excerpt(data)}")
    return kinds[found[0]](value)


def _excerpt(data: bytes) -> str:
    return repr(printable(data[:400].decode("utf-8", "replace"), 80))


def _values(value: dict[str, Any]) -> Answer | Fault:
    stages = value["stages"]
    return Values(stages) if isinstance(stages, dict) else Fault("answer", "stages is not an object")


def _refusal(value: dict[str, Any]) -> Answer | Fault:
    refusal, offset, message = value["refused"], value.get("offset"), value.get("message")
    if not isinstance(refusal, str):
        return Fault("answer", "refused is not a string")
    text = message if isinstance(message, str) else ""
    # bool is an int to Python, and true no number to JSON.
    where = offset if type(offset) is int and abs(offset) < 1 << 64 else None
    place = "" if where is None else f" (byte {where})"
    return Refusal(printable(refusal, 80), printable(text) + place, where)


def _capabilities(value: dict[str, Any]) -> Answer | Fault:
    claims = value[CAPABILITIES]
    if not isinstance(claims, dict) or claims.get("protocol") != PROTOCOL:
        return Fault("answer", f"capabilities is not an object whose protocol is {PROTOCOL!r}")
    for name in ("versions", "profiles", "stages"):
        items = claims.get(name)
        if not isinstance(items, list) or not all(isinstance(item, str) for item in items):
            return Fault("answer", f"{name} of the capabilities is not a list of strings")
    decoder = claims.get("decoder")
    return Capabilities(
        printable(decoder, 100) if isinstance(decoder, str) else "unnamed",
        frozenset(claims["versions"]),
        frozenset(claims["profiles"]),
        tuple(stage for stage in STAGES if stage in claims["stages"]),
    )
