"""Questions as commands, answers as untrusted bytes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from scarfmt_conformance.protocol import Capabilities, Fault, Question, Refusal, Values, command, fill, parse, template

from scarfmt.errors import InvalidInput
from tests.samples.codec_samples import refuses


def test_a_command_is_split_as_a_shell_would_and_filled_without_one() -> None:
    """Names with spaces, quotes and even places in them stay whole."""
    words = template("'my decoder' --in={file} {k}/{layers} {s} {stage} {other}")
    question = Question(Path("/a b/{stage};$(x).scar"), 2, "all")
    expected = ["my decoder", "--in=/a b/{stage};$(x).scar", "2/2", "all", "all", "{other}"]
    assert fill(words, question) == expected


def test_a_command_may_ask_for_the_camera() -> None:
    """Three numbers that read back exactly; nothing where no camera is asked for."""
    words = template("x {file} {layers} {stage} --camera={camera}")
    assert fill(words, Question(Path("a"), 0, "all", (1e272, -0.1, 0.0)))[-1] == "--camera=1e+272,-0.1,0.0"
    assert fill(words, Question(Path("a"), 0, "all"))[-1] == "--camera="


@pytest.mark.parametrize(
    ("text", "missing"),
    [("x", "{file}, {layers}, {stage}"), ("x {file} {k}", "{stage}"), ("x {layers} {s}", "{file}")],
)
def test_a_command_without_a_place_is_refused(text: str, missing: str) -> None:
    with pytest.raises(InvalidInput, match="has no") as caught:
        template(text)
    assert caught.value.refusal == "input-options"
    assert caught.value.message.endswith(missing)


@pytest.mark.parametrize("text", ["", "  ", "x 'open"])
def test_a_command_that_is_none_is_refused(text: str) -> None:
    refuses("input-options", lambda: command(text))


def test_answers_are_told_apart() -> None:
    assert parse(b' {"stages": {"values": 1}}\n') == Values({"values": 1})
    assert parse(b'{"refused": "bad-table", "offset": 9, "message": "why"}') == Refusal("bad-table", "why (byte 9)", 9)
    assert parse(b'{"refused": "bad-table", "offset": null}') == Refusal("bad-table", "")
    assert parse(b'{"refused": "bad-table", "offset": {}, "message": []}') == Refusal("bad-table", "")
    assert parse(b'{"refused": "bad-table", "offset": true}') == Refusal("bad-table", "")


def claims(**changed: Any) -> bytes:
    good = {"protocol": "scar-conformance 2", "decoder": "d 1", "versions": ["0.1"], "profiles": [], "stages": []}
    return json.dumps({"capabilities": {**good, **changed}}).encode()


def test_capabilities_keep_the_stages_known_in_their_order() -> None:
    answer = parse(claims(stages=["values", "container", "a later stage"], profiles=["explicit"]))
    assert answer == Capabilities("d 1", frozenset({"0.1"}), frozenset({"explicit"}), ("container", "values"))


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"protocol": "scar-conformance 1"}, "protocol"),
        ({"stages": "values"}, "stages"),
        ({"versions": [0.1]}, "versions"),
        ({"profiles": None}, "profiles"),
    ],
)
def test_wrong_capabilities_are_a_fault_that_says_which(changed: dict[str, Any], reason: str) -> None:
    answer = parse(claims(**changed))
    assert isinstance(answer, Fault)
    assert reason in answer.message


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "printed nothing"),
        (b" \n", "printed nothing"),
        (b"{}\n", "not an object with stages, refused or capabilities"),
        (b"[1]", "not an object with"),
        (b'{"refused": "x-y"}\n{"refused": "x-y"}\n', "not one JSON value"),
        (b'{"refused": "x-y", "stages": {}}', "not an object with"),
        (b'{"refused": 5}', "refused is not a string"),
        (b'{"stages": []}', "stages is not an object"),
        (b'{"capabilities": {}}', "protocol"),
    ],
)
def test_other_output_is_a_fault_that_says_why(data: bytes, reason: str) -> None:
    answer = parse(data)
    assert isinstance(answer, Fault)
    assert (answer.kind, reason in answer.message) == ("answer", True)
