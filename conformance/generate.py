"""Writes the conformance vectors: ``python -m conformance.generate [--check] [--only ID ...]``.

Every vector is ``input.scar``, ``expect.json`` and, of small scenes, references of activated values, in the zip of its
class (:mod:`scarfmt_conformance.archive`).
Valid files come from scenes made here; the readable decoder, which must get from them what the scenes hold, gives their
expectations (:mod:`conformance.expect.document`), not a decoder of this package. An invalid file is a valid one with
exactly one rule broken and every checksum right that is not itself the fault. ``manifest.json`` is written too. Running
twice gives equal bytes.
"""

from __future__ import annotations

import argparse
import fnmatch
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scarfmt_conformance.archive import VECTORS as FOLDER
from scarfmt_conformance.archive import archives, members, write_zip

from conformance.expect.document import BITSTREAM, FORMAT, expectation
from conformance.expect.json_text import json_text
from conformance.faults.catalogue import invalid_files
from conformance.faults.container_faults import container_faults
from conformance.faults.either_cases import either_cases
from conformance.faults.limit_faults import limit_faults
from conformance.faults.metadata_faults import metadata_faults
from conformance.faults.stream_faults import stream_faults
from conformance.faults.streaming_faults import streaming_faults
from conformance.faults.truncated_cases import truncated_cases
from conformance.faults.work_cases import work_cases
from conformance.scenes.cases import Case
from conformance.scenes.edge_scenes import edge_cases
from conformance.scenes.streaming_scenes import streaming_cases
from conformance.scenes.valid_cases import valid_cases

ROOT = Path(__file__).resolve().parent
VECTORS = ROOT / FOLDER
_MANIFEST = "manifest.json"
_LICENCE = "CC0-1.0"
Files = dict[str, bytes]
_CLOSE = 1e-12
"""Relative difference of two references of an activated value that another machine's exp or tanh may make."""


def cases() -> Iterator[Case]:
    """Every vector, each id once.

    Raises:
        ValueError: two have the same id.
    """
    seen: set[str] = set()
    for case in _all_cases():
        if case.id in seen:
            raise ValueError(f"two vectors have the id {case.id}")
        seen.add(case.id)
        yield case


def _all_cases() -> Iterator[Case]:
    valid = list(valid_cases())
    yield from valid
    yield from edge_cases()
    yield from streaming_cases()
    files = {case.id.rpartition("/")[2]: (case.data, case.scene) for case in valid if case.scene is not None}
    yield from invalid_files(files)
    yield from container_faults()
    yield from stream_faults(files)
    yield from limit_faults()
    yield from metadata_faults()
    yield from streaming_faults()
    yield from work_cases()
    yield from either_cases(files)
    yield from truncated_cases(files)


def vector_files(case: Case) -> tuple[dict[str, Any], Files]:
    """The row of the manifest, and the files of a vector by their path below ``conformance/``."""
    expect, extra = expectation(case)
    folder = f"{FOLDER}/{case.id}"
    row = {
        "id": case.id,
        "class": expect["class"],
        "file": f"{folder}/input.scar",
        "expect": f"{folder}/expect.json",
        **expect["file"],
        **{name: expect[name] for name in ("profile", "features", "rules", "result")},
        **{name: expect[name] for name in ("refusal", "refusals") if name in expect},
        "layers": len(expect.get("layers", [])),
        "since": BITSTREAM,
    }
    files = {row["file"]: case.data, row["expect"]: json_text(expect).encode()}
    return row, {**files, **{f"{folder}/{path}": data for path, data in extra.items()}}


def generate(only: list[str]) -> tuple[Files, list[str]]:
    """Every file by its path below ``conformance/``, and the ids; with patterns `only`, just those vectors."""
    files: Files = {}
    rows = []
    for case in cases():
        if not only or any(fnmatch.fnmatchcase(case.id, pattern) for pattern in only):
            row, made = vector_files(case)
            rows.append(row)
            files |= made
    rows.sort(key=lambda row: str(row["id"]))
    if not only:
        manifest = {"format": FORMAT, "bitstream": BITSTREAM, "licence": _LICENCE, "vectors": rows}
        files[_MANIFEST] = json_text(manifest, levels=2).encode()
    return files, [row["id"] for row in rows]


def same(name: str, found: bytes | None, content: bytes) -> bool:
    """Whether a file is as it should be: references of activated values but for rounding of another libm."""
    if found is None or found == content or not name.endswith(".bin") or len(found) != len(content):
        return found == content
    there, here = np.frombuffer(found, "<f8"), np.frombuffer(content, "<f8")
    return bool(np.allclose(there, here, rtol=_CLOSE, atol=_CLOSE, equal_nan=True))


def list_written() -> Files:
    """Every file there is, by its path below ``conformance/``."""
    return {**members(ROOT), **{path.name: path.read_bytes() for path in ROOT.glob(_MANIFEST)}}


def _write(files: Files) -> None:
    """Write the manifest, and the archive of every class; remove that of a class without vectors."""
    classes: dict[str, Files] = {path.stem: {} for path in archives(ROOT)}
    for name, content in files.items():
        if name == _MANIFEST:
            (ROOT / name).write_bytes(content)
        else:
            classes.setdefault(name.split("/")[1], {})[name] = content
    VECTORS.mkdir(exist_ok=True)
    for class_, content_of in classes.items():
        path = VECTORS / f"{class_}.zip"
        if content_of:
            write_zip(path, content_of)
        else:
            path.unlink()


def main(arguments: list[str]) -> int:
    """Write all vectors, or with ``--check`` compare them; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m conformance.generate")
    parser.add_argument("--check", action="store_true", help="compare with the files there; write nothing")
    parser.add_argument("--only", nargs="+", default=[], metavar="ID", help="patterns of ids; makes no manifest")
    options = parser.parse_args(arguments)
    files, ids = generate(options.only)
    if not ids:
        parser.error("no vector has such an id")
    there = list_written()
    stale = [name for name, content in files.items() if not same(name, there.get(name), content)]
    left = [] if options.only else sorted(set(there) - set(files))
    if not options.check and (stale or left):
        kept = {name: content for name, content in there.items() if name not in left}
        _write({**kept, **{name: files[name] for name in stale}})
    done = "differ" if options.check else "changed"
    size = sum(map(len, files.values()))
    print(f"{len(ids)} vectors, {size:,} bytes, {len(stale) + len(left)} files {done}")
    for name in [*stale, *(f"{name} (no longer made)" for name in left)] if options.check else []:
        print(f"  {name}")
    return 1 if options.check and (stale or left) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
