"""Questions to planners, and the answers in either language: ``python -m tests.streaming.plan_cases`` writes them.

A case is JSON: numbers are those of binary64, the block is base64. `web/test/plan.test.ts` reads the same file.
"""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np

from scarfmt.blocks.streaming import Streaming, pack_streaming, unpack_streaming
from scarfmt.streaming.plan import SceneIndex, plan
from scarfmt.streaming.view import Camera
from tests.conftest import REPOSITORY

CASES = REPOSITORY / "web" / "test" / "data" / "plans.json"
STORED = range(8)
"""Seeds of the cases that are kept."""

Case = dict[str, Any]


def random_case(seed: int) -> Case:
    """Tiles, a block or none, a camera, and what was fetched already; the answer is not among it."""
    draw = np.random.default_rng(seed)
    tiles, layers = int(draw.integers(1, 30)), int(draw.integers(1, 6))
    side = 2.0 ** draw.integers(-2, 3, tiles)
    low = draw.normal(0, 6, (tiles, 3))
    sizes = np.where(draw.random((tiles, layers)) < 0.15, 0, draw.integers(40, 40_000, (tiles, layers)))
    case: Case = {
        "tiles": tiles,
        "layers": layers,
        "boxes": np.concatenate([low, low + side[:, None]], axis=1).ravel().tolist(),
        "bytes": sizes.astype(float).ravel().tolist(),
        "counts": draw.integers(0, 9000, tiles * layers).tolist(),
        "modelBytes": draw.integers(0, 60_000, layers).astype(float).tolist(),
        "annotation": None,
        "camera": _camera(draw),
        "have": np.where(draw.random(tiles) < 0.5, 0, draw.integers(0, layers + 1, tiles)).tolist(),
    }
    if seed % 4:
        told = _told(draw, tiles, layers + seed % 3, case["camera"]["position"])
        case["annotation"] = base64.b64encode(pack_streaming(told)).decode()
    return case


def _camera(draw: np.random.Generator) -> Case:
    forward = draw.normal(size=3)
    camera = {
        "position": draw.normal(0, 5, 3).tolist(),
        "forward": (forward / np.linalg.norm(forward)).tolist(),
        "up": draw.normal(size=3).tolist(),
        "fovY": float(draw.uniform(0.2, 2.8)),
        "width": int(draw.integers(100, 2000)),
        "height": int(draw.integers(100, 2000)),
    }
    return camera if draw.random() < 0.5 else {**camera, "velocity": draw.normal(size=3).tolist()}


def _told(draw: np.random.Generator, tiles: int, layers: int, eye: list[float]) -> Streaming:
    viewpoints = draw.normal(0, 5, (int(draw.integers(0, 6)), 3)).astype(np.float32)
    if len(viewpoints) and draw.random() < 0.2:
        viewpoints[0] = eye
    corners = np.sort(draw.integers(0, 256, (2, tiles, 3)), axis=0).astype(np.uint8)
    # Few different gains, so that many are equal.
    gains = draw.integers(0, 60, (len(viewpoints), layers, tiles)) * draw.integers(1, 5)
    reach = np.where(draw.random(tiles) < 0.3, 0, draw.integers(90, 140, tiles)).astype(np.uint8)
    return Streaming(corners[0], corners[1], reach, viewpoints, gains.astype(np.uint8))


def answer(case: Case) -> list[list[int]]:
    """The answer of the planner in Python: [tile, layer] in order."""
    tiles, layers = case["tiles"], case["layers"]
    index = SceneIndex(
        np.array(case["boxes"]).reshape(tiles, 6),
        np.array(case["bytes"]).reshape(tiles, layers),
        np.array(case["counts"], np.int64).reshape(tiles, layers),
        np.array(case["modelBytes"]),
    )
    told = None if case["annotation"] is None else unpack_streaming(base64.b64decode(case["annotation"]))
    return [list(step) for step in plan(index, told, camera_of(case["camera"]), case["have"])]


def camera_of(told: Case | None) -> Camera | None:
    """The camera of a case."""
    if told is None:
        return None
    position, forward, up = (np.array(told[name]) for name in ("position", "forward", "up"))
    velocity = np.array(told["velocity"]) if "velocity" in told else None
    return Camera(position, forward, up, told["fovY"], told["width"], told["height"], velocity)


def stored() -> list[Case]:
    """The cases that are kept, with their answers as `steps`."""
    cases = [random_case(seed) for seed in STORED]
    cases.append({**random_case(1), "camera": None})
    return [{**case, "steps": answer(case)} for case in cases]


def write(path: Path, cases: list[Case]) -> None:
    """A line a case."""
    path.write_text("[\n" + ",\n".join(json.dumps(case, separators=(",", ":")) for case in cases) + "\n]\n")


if __name__ == "__main__":
    write(CASES, stored())
