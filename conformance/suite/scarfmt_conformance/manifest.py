"""The vectors of a suite: ``manifest.json`` and the ``expect.json`` of each, checked before a decoder is asked.

A suite is trusted to be no attack, not to be whole: every fault of it is an :class:`InvalidInput` that names the file,
so that a damaged download is never held against a decoder.
"""

from __future__ import annotations

import fnmatch
import hashlib
import json
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from scarfmt.errors import InvalidInput
from scarfmt_conformance.archive import OWN, unpack
from scarfmt_conformance.protocol import ANNOTATIONS, PROTOCOL

MANIFEST = "manifest.json"
RESULTS = ("decoded", "refused", "either")
METADATA_REFUSALS = frozenset({"bad-metadata", "limit-metadata"})
REFUSAL_STAGES = ("container", "models", "tiles", *ANNOTATIONS)


@dataclass(frozen=True)
class Vector:
    """One entry of the manifest.

    Attributes:
        id: class, slash, name.
        class_: ``valid``, ``edge``, ``invalid``, ``either`` or ``truncated``.
        file: the .scar file.
        expect: its ``expect.json``.
        bytes: length of the file.
        sha256: of the file, lower case.
        profile: ``explicit``, ``anchor``, or None where the file does not tell.
        features: words to select it by.
        rules: ids of the rules of SPEC.md that it exercises.
        result: one of `RESULTS`.
    """

    id: str
    class_: str
    file: Path
    expect: Path
    bytes: int
    sha256: str
    profile: str | None
    features: frozenset[str]
    rules: tuple[str, ...]
    result: str


@dataclass(frozen=True)
class Suite:
    """A manifest.

    Attributes:
        folder: where it is.
        bitstream: version of the format that its files are of.
        vectors: in the order of the manifest.
    """

    folder: Path
    bitstream: str
    vectors: tuple[Vector, ...]


@dataclass(frozen=True)
class Layer:
    """The pinned results of a decode to one layer: `stages` by name, in the form of the answers of PROTOCOL.md."""

    layer: int
    stages: dict[str, Any]


@dataclass(frozen=True)
class Expectation:
    """An ``expect.json``.

    Attributes:
        purpose: what the vector is there for.
        layers: pinned, ascending.
        annotations: stage -> the object of the file, None if it must have none; of those that are to be compared.
        refusals: ids it may be refused with.
        stage: one of `REFUSAL_STAGES`, where the refusal comes at the latest; ``tiles`` where that is not said.
        extend_to: length up to which zeros follow the file; 0 for none.
        offsets: first and past of the bytes in which the fault of a refused file is; None where no offset is pinned.
        camera: centre of the camera, world units, for which Gaussians are pinned; None where none are.
    """

    purpose: str
    layers: tuple[Layer, ...]
    annotations: dict[str, Any]
    refusals: tuple[str, ...]
    stage: str
    extend_to: int
    camera: tuple[float, ...] | None = None
    offsets: tuple[int, int] | None = None


@dataclass(frozen=True)
class Selection:
    """A selection of vectors: they match one of `only` and one of `classes`, and have all `features`.

    Attributes:
        only: patterns of ids, as a shell has them; none for all.
        classes: none for all.
        features: words that a vector must have.
    """

    only: tuple[str, ...] = ()
    classes: tuple[str, ...] = ()
    features: tuple[str, ...] = ()

    def of(self, vectors: Iterable[Vector]) -> list[Vector]:
        """The vectors selected.

        Raises:
            InvalidInput: ``input-options``: there are none.
        """
        chosen = [vector for vector in vectors if self._takes(vector)]
        if not chosen:
            raise InvalidInput("input-options", "no vector is of that name, class and feature; see conformance list")
        return chosen

    def _takes(self, vector: Vector) -> bool:
        named = not self.only or any(fnmatch.fnmatchcase(vector.id, pattern) for pattern in self.only)
        return named and vector.class_ in (self.classes or (vector.class_,)) and vector.features >= set(self.features)


def find_suite(place: str | None) -> Path:
    """The folder or zip of the suite.

    Args:
        place: the one wanted; None for ``./conformance``, else that of the checkout this package is in, else the zip
            that was installed with it.

    Raises:
        InvalidInput: ``input-suite``: there is no manifest, and no such zip.
    """
    usual = [Path("conformance"), Path(__file__).resolve().parents[2], OWN]
    candidates = usual if place is None else [Path(place)]
    for candidate in candidates:
        if (candidate / MANIFEST).is_file() or zipfile.is_zipfile(candidate):
            return candidate.resolve()
    places = " or ".join(str(candidate) for candidate in candidates)
    raise InvalidInput("input-suite", f"no {MANIFEST} in {places}: give the folder or zip of the vectors with --suite")


@contextmanager
def open_suite(place: Path) -> Iterator[Suite]:
    """The suite in a folder or zip; the files of a zip exist only meanwhile.

    Raises:
        InvalidInput: ``input-suite``: it cannot be read, or is not one.
    """
    with ExitStack() as opened:
        try:
            folder = opened.enter_context(unpack(place))
        except (zipfile.BadZipFile, OSError) as error:
            raise _refusal(place, f"it cannot be unpacked: {error}") from error
        yield load_suite(folder)


def load_suite(folder: Path) -> Suite:
    """Read a manifest.

    Raises:
        InvalidInput: ``input-suite``: it cannot be read, or is not one.
    """
    path = folder / MANIFEST
    manifest = _read_object(path)
    if manifest.get("format") != PROTOCOL:
        raise _refusal(path, f"its format is {manifest.get('format')!r}, this runner knows {PROTOCOL!r}")
    try:
        vectors = tuple(_vector(folder, entry) for entry in manifest["vectors"])
        bitstream = str(manifest["bitstream"])
    except (KeyError, TypeError, ValueError) as error:
        raise _refusal(path, f"it is not a manifest ({error!r})") from error
    if len({vector.id for vector in vectors}) < len(vectors):
        raise _refusal(path, "an id stands twice in it")
    return Suite(folder, bitstream, vectors)


def _vector(folder: Path, entry: dict[str, Any]) -> Vector:
    if entry["result"] not in RESULTS:
        raise ValueError(f"result {entry['result']!r} of {entry['id']}")
    return Vector(
        str(entry["id"]),
        str(entry["class"]),
        folder / _inside(entry["file"]),
        folder / _inside(entry["expect"]),
        int(entry["bytes"]),
        str(entry["sha256"]),
        entry.get("profile"),
        frozenset(entry.get("features", ())),
        tuple(entry.get("rules", ())),
        entry["result"],
    )


def _inside(name: str) -> PurePosixPath:
    """A path of the manifest, which must not lead out of the suite."""
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts:
        raise ValueError(f"path {name!r}")
    return path


def check_file(vector: Vector) -> None:
    """Check that the file of a vector is the one the manifest means.

    Raises:
        InvalidInput: ``input-suite``.
    """
    try:
        data = vector.file.read_bytes()
    except OSError as error:
        raise _refusal(vector.file, str(error.strerror)) from error
    if len(data) != vector.bytes or hashlib.sha256(data).hexdigest() != vector.sha256:
        raise _refusal(vector.file, "it is not the file of the manifest: get the suite again, with its line ends")


def load_expectation(vector: Vector) -> Expectation:
    """Read the ``expect.json`` of a vector.

    Raises:
        InvalidInput: ``input-suite``.
    """
    value = _read_object(vector.expect)
    try:
        expectation = _expectation(value)
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise _refusal(vector.expect, f"it is not an expectation ({error!r})") from error
    if value.get("result") != vector.result:
        raise _refusal(vector.expect, "its result is not that of the manifest")
    if vector.result != "decoded" and not expectation.refusals:
        raise _refusal(vector.expect, "it names no refusal")
    if vector.result == "decoded" and not expectation.layers:
        raise _refusal(vector.expect, "it pins no layer")
    return expectation


def _expectation(value: dict[str, Any]) -> Expectation:
    refusals = value["refusals"] if "refusals" in value else [value["refusal"]] if "refusal" in value else []
    stage = value.get("stage") or ("metadata" if refusals and METADATA_REFUSALS.issuperset(refusals) else "tiles")
    if stage not in REFUSAL_STAGES:
        raise ValueError(f"stage {stage!r}")
    camera, offsets = value.get("camera"), value.get("offsets")
    return Expectation(
        str(value.get("purpose", "")),
        tuple(Layer(int(layer["layer"]), dict(layer["stages"])) for layer in value.get("layers") or ()),
        {stage: value[stage] for stage in ANNOTATIONS if stage in value},
        tuple(str(refusal) for refusal in refusals),
        stage,
        int(value.get("extend_to") or 0),
        None if camera is None else (float(camera[0]), float(camera[1]), float(camera[2])),
        None if offsets is None else (int(offsets[0]), int(offsets[1])),
    )


def _read_object(path: Path) -> dict[str, Any]:
    try:
        value = json.loads(path.read_bytes())
    except OSError as error:
        raise _refusal(path, str(error.strerror)) from error
    except ValueError as error:
        raise _refusal(path, f"it is not JSON: {error}") from error
    if not isinstance(value, dict):
        raise _refusal(path, "it is not a JSON object")
    return value


def _refusal(path: Path, fault: str) -> InvalidInput:
    return InvalidInput("input-suite", f"{path}: {fault}")
