"""The decoders of the browser package against the reference decoder."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import scarfmt
from scarfmt import GaussianScene

ARRAYS = ("centres", "scales", "quats", "opacity", "sh")


def dumped(web: Path, file: Path, layers: int, degree: int) -> dict[str, NDArray[np.float32]]:
    """The output of web/test/dump.ts with tiles put together: arrays of ARRAYS, (n, width) each."""
    command = ["node", str(web / "dist" / "tests" / "dump.mjs"), str(file), str(layers)]
    data = subprocess.run(command, cwd=web, capture_output=True, timeout=120, check=True).stdout
    widths = (3, 3, 4, 1, 3 * (degree + 1) ** 2)
    parts: dict[str, list[NDArray[np.float32]]] = {name: [] for name in ARRAYS}
    at = 0
    while at < len(data):
        count = int.from_bytes(data[at : at + 4], "little")
        at += 4
        for name, width in zip(ARRAYS, widths, strict=True):
            parts[name].append(np.frombuffer(data, "<f4", count * width, at).reshape(count, width))
            at += 4 * count * width
    return {name: np.concatenate(arrays) for name, arrays in parts.items()}


@pytest.mark.parametrize("layers", [1, 3, 5])
def test_values_are_those_of_the_reference(web: Path, layers: int) -> None:
    """Order and values, after single precision: a viewer shows what `scarfmt decode` writes."""
    file = web / "test" / "data" / "toys.scar"
    scene = scarfmt.decode(file, layers=layers).scene
    assert isinstance(scene, GaussianScene)
    found = dumped(web, file, layers, 3)
    n = len(scene.positions)
    np.testing.assert_allclose(found["centres"], scene.positions, rtol=1e-6)
    np.testing.assert_allclose(found["scales"], np.exp(scene.log_scales), rtol=1e-5)
    np.testing.assert_allclose(found["quats"], scene.rotations, atol=2e-5)
    np.testing.assert_allclose(found["opacity"][:, 0], 1 / (1 + np.exp(-scene.opacity_logits.reshape(n))), atol=1e-5)
    np.testing.assert_allclose(found["sh"], scene.sh.reshape(n, -1), atol=2e-5)
