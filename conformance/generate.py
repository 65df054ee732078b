"""Writes the conformance vectors: ``python -m conformance.generate [--check]``.

Every vector is a folder with ``input.scar`` and ``expect.json``. Valid files come from scenes made here, their
expectations from the same scenes (:mod:`conformance.expectations`), not from a decoder. An invalid file is a valid one
with exactly one rule broken and every checksum right that is not itself the fault. Running twice gives equal bytes.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from conformance.expectations import expected_layers, pinned
from conformance.faults import invalid_files
from conformance.files import vector_file
from conformance.neural_scenes import neural_plans
from conformance.scenes import build, static_plans, worked_scene
from scarfmt.container import Block
from scarfmt.schema import BlockFlag
from scarfmt.source import BytesSource
from scarfmt.truncate import truncate
from scarfmt.writer import QuantisedScene

VECTORS = Path(__file__).resolve().parent / "vectors"
FORMAT = "scar-conformance 1"
_ANNOTATIONS = (
    Block(65, 1, b"unknown annotation", flags=int(BlockFlag.SAFE_TO_COPY)),
    Block(130, 1, b"private, bound to a tile", tile=0, flags=0),
    Block(200, 2, b"private", flags=0),
)
# Among them files cut where the index network is there, but not the residual codebook that one of its heads is for.
_TRUNCATED = (
    ("explicit-refined", 1),
    ("explicit-refined", 2),
    ("annotations", 1),
    ("predictors", 1),
    ("predictors", 2),
    ("index-flat", 1),
    ("index-edge", 1),
    ("index-modes", 1),
    ("index-modes", 3),
    ("anchors-neural", 1),
)


def _file_facts(data: bytes) -> dict[str, Any]:
    return {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}


def accepted(purpose: str, data: bytes, scene: QuantisedScene, layers: int | None = None) -> dict[str, Any]:
    """The expectation of a valid file that holds the first `layers` layers of `scene`."""
    states = expected_layers(scene)[:layers]
    return {
        "format": FORMAT,
        "purpose": purpose,
        "file": _file_facts(data),
        "result": "decoded",
        "layers": [
            {"layer": number, "anchors": len(arrays["code"]), "arrays": pinned(arrays)}
            for number, arrays in enumerate(states, start=1)
        ],
    }


def refused(purpose: str, data: bytes, rule: str, refusal: str) -> dict[str, Any]:
    """The expectation of a file that breaks `rule`."""
    return {
        "format": FORMAT,
        "purpose": purpose,
        "file": _file_facts(data),
        "result": "refused",
        "rule": rule,
        "refusal": refusal,
    }


def vectors() -> Iterator[tuple[str, bytes, dict[str, Any]]]:
    """(folder below vectors/, file, expectation) of every vector."""
    worked = worked_scene()
    data = vector_file(worked)
    yield "worked", data, accepted("the worked file of SPEC.md, appendix B", data, worked)
    files: dict[str, tuple[bytes, QuantisedScene]] = {}
    for name, (purpose, plan) in {**static_plans(), **neural_plans()}.items():
        scene = build(plan)
        data = vector_file(scene, _ANNOTATIONS if name == "annotations" else ())
        files[name] = data, scene
        yield f"valid/{name}", data, accepted(purpose, data, scene)
    for name, layers in _TRUNCATED:
        whole, scene = files[name]
        data = truncate(BytesSource(whole), layers)
        purpose = f"{name} truncated to layer {layers}: equals what an editor makes of it (SPEC §14)"
        yield f"truncated/{name}-{layers}", data, {
            **accepted(purpose, data, scene, layers), "from": f"valid/{name}", "to_layer": layers,
        }
    for name, purpose, rule, refusal, data in invalid_files({name: file for name, (file, _) in files.items()}):
        yield f"invalid/{name}", data, refused(purpose, data, rule, refusal)


def main(arguments: list[str]) -> int:
    """Write all vectors, or with ``--check`` compare them; returns the exit status."""
    check = arguments == ["--check"]
    stale, names = [], set()
    for name, data, expectation in vectors():
        folder = VECTORS / name
        names.add(name)
        text = (json.dumps(expectation, indent=1) + "\n").encode()
        for path, content in ((folder / "input.scar", data), (folder / "expect.json", text)):
            if path.exists() and path.read_bytes() == content:
                continue
            stale.append(str(path.relative_to(VECTORS)))
            if not check:
                folder.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
    found = {str(path.parent.relative_to(VECTORS)) for path in VECTORS.glob("**/expect.json")}
    stale += [f"{name} (no longer made)" for name in sorted(found - names)]
    print(f"{len(names)} vectors, {len(stale)} files {'differ' if check else 'changed'}")
    for name in stale if check else []:
        print(f"  {name}")
    return 1 if check and stale else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
