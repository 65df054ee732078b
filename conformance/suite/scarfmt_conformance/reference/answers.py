"""The reference decoder's side of the conformance protocol, conformance/PROTOCOL.md.

``python -m scarfmt_conformance.reference.answers FILE --layers K --stage STAGE`` answers one question, ``--session``
those on standard input, one JSON object a line. A refusal is an answer; anything else that goes wrong ends the process.
"""

from __future__ import annotations

import argparse
import base64
import hashlib
import json
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TextIO

from scarfmt import __version__
from scarfmt.errors import InvalidInput, ScarError
from scarfmt_conformance.protocol import ANNOTATIONS, METADATA, PROTOCOL, STAGES, STREAMING

if TYPE_CHECKING:
    # The rest comes when it is needed: a suite starts this program hundreds of times.
    from numpy.typing import NDArray

    from scarfmt.coding.reader import SceneReader

CAPABILITIES = {
    "protocol": PROTOCOL,
    "decoder": f"scarfmt reference {__version__}",
    "versions": ["0.3"],
    "profiles": ["explicit", "anchor"],
    "stages": list(STAGES),
}
# Ids that no bytes of a file can cause: of calls and machines, beside the InvalidInput ones.
_NOT_OF_FILES = frozenset({"block-range", "truncated-source", "inexact-device"})
_SHOWN = 8

Answer = dict[str, Any]


@dataclass(frozen=True)
class Manner:
    """How files are decoded; the answers do not depend on it.

    Attributes:
        native: also decode with the C library, which must give the same values.
        camera: centre of the camera, world units, for Gaussians of the anchor profile; None: `origin` of the header.
    """

    native: bool = False
    camera: tuple[float, ...] | None = None


def answer(path: str, layers: int, stage: str, manner: Manner) -> Answer:
    """The answer to one question.

    Args:
        path: the file, or its URL.
        layers: to decode to, 0 for all.
        stage: one of `STAGES`, ``all`` or ``capabilities``.
        manner: how to decode.

    Raises:
        InvalidInput: the file cannot be opened, or has no such layer: not an answer.
        Truncated: ``truncated-source`` when the file shrinks meanwhile.
        ValueError: no such stage.
    """
    if stage == "capabilities":
        return {"capabilities": CAPABILITIES}
    if stage not in (*STAGES, "all"):
        raise ValueError(f"no stage {stage!r}: there are {', '.join(STAGES)}")
    from scarfmt.coding.reader import SceneReader
    from scarfmt.container.source import open_source

    with open_source(path) as source:
        try:
            return {"stages": dict(_stages(SceneReader(source), layers, stage, manner))}
        except ScarError as error:
            if isinstance(error, InvalidInput) or error.refusal in _NOT_OF_FILES:
                raise
            return {"refused": error.refusal, "offset": error.offset, "message": error.message}


def _stages(reader: SceneReader, layers: int, stage: str, manner: Manner) -> Iterator[tuple[str, Answer]]:
    """The stages asked for, from one decode that goes no further than they need.

    ``all`` leaves out annotations: a decode must not look at them (SPEC §7.10, §7.13).
    """
    import numpy as np

    from scarfmt.blocks.metadata import read_metadata
    from scarfmt.blocks.streaming import read_streaming
    from scarfmt_conformance.reference import stages as of

    if stage == METADATA:
        yield stage, {stage: read_metadata(reader.container)}
        return
    if stage == STREAMING:
        yield stage, {stage: of.streaming(read_streaming(reader.container))}
        return
    wanted = tuple(each for each in STAGES if each not in ANNOTATIONS) if stage == "all" else (stage,)
    if "container" in wanted:
        yield "container", {"container": of.container(reader.container)}
    if wanted == ("container",):
        return
    models = reader.models(layers or None)
    if "models" in wanted:
        yield "models", hash_arrays(of.models(models))
    if wanted == ("models",):
        return
    found = of.decoding(reader, models)
    if manner.native:
        of.check_native(found)
    for name, arrays in of.EXACT.items():
        if name in wanted:
            yield name, hash_arrays(arrays(found))
    if "activated" in wanted:
        yield "activated", encode_arrays(of.activated_arrays(found.decoded, np.float64, manner.camera))


def _little(array: NDArray[Any]) -> NDArray[Any]:
    """The array as answers have it, little-endian: most NumPy functions give the byte order of the machine."""
    return array.astype(array.dtype.newbyteorder("<"))


def hash_arrays(arrays: dict[str, NDArray[Any]]) -> Answer:
    """Arrays of an exact stage as they are answered: hashes, and the first numbers for someone who looks for a bug."""
    out = {}
    for name, array in sorted(arrays.items()):
        little = _little(array)
        out[name] = {
            "dtype": little.dtype.str,
            "shape": list(little.shape),
            "sha256": hashlib.sha256(little.tobytes()).hexdigest(),
            "first": little.ravel()[:_SHOWN].tolist(),
        }
    return {"arrays": out}


def encode_arrays(arrays: dict[str, NDArray[Any]]) -> Answer:
    """Activated arrays as they are answered: the numbers themselves, in base64."""
    out = {}
    for name, array in sorted(arrays.items()):
        little = _little(array)
        data = base64.b64encode(little.tobytes()).decode("ascii")
        out[name] = {"dtype": little.dtype.str, "shape": list(little.shape), "data": data}
    return {"arrays": out}


def session(questions: TextIO, answers: TextIO, manner: Manner) -> None:
    """Answer the questions of a stream, a line each, until it ends."""
    for line in questions:
        question = json.loads(line)
        asked = replace(manner, camera=tuple(question.get("camera") or ()) or None)
        _write(answer(question["file"], question["layers"], question["stage"], asked), answers)


def _write(reply: Answer, stream: TextIO) -> None:
    stream.write(json.dumps(reply, allow_nan=False, separators=(",", ":")) + "\n")
    stream.flush()


def _camera(text: str) -> tuple[float, ...] | None:
    """Three numbers with commas between them; nothing for None."""
    if not text:
        return None
    x, y, z = map(float, text.split(","))
    return x, y, z


def _arguments(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m scarfmt_conformance.reference.answers",
        description="Answer questions of the conformance protocol.",
    )
    parser.add_argument("file", nargs="?", help="the file, or its URL")
    parser.add_argument("--session", action="store_true", help="answer questions from standard input instead")
    parser.add_argument("--layers", type=int, default=0, help="number of layers to decode, 0 for all (default)")
    parser.add_argument("--camera", type=_camera, help="X,Y,Z of the camera [default: the origin in the header]")
    parser.add_argument("--stage", default="all", choices=("all", "capabilities", *STAGES), help="what to answer")
    parser.add_argument("--native", action="store_true", help="also compare with the C library")
    parsed = parser.parse_args(arguments)
    if parsed.session == (parsed.file is not None):
        parser.error("give either a file or --session")
    return parsed


def main(arguments: list[str] | None = None) -> None:
    """The program."""
    parsed = _arguments(arguments)
    # Before numpy is imported: products this small are slower with threads.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    manner = Manner(parsed.native, parsed.camera)
    if parsed.session:
        session(sys.stdin, sys.stdout, manner)
    else:
        _write(answer(parsed.file, parsed.layers, parsed.stage, manner), sys.stdout)


if __name__ == "__main__":
    main()
