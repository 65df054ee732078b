"""Gaussians as people make them: their arrays have the types that everything else counts on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scarfmt.scene.gaussians import GaussianScene


def made(kind: Callable[[NDArray[Any]], Any]) -> GaussianScene:
    """Gaussians of whole numbers, which all types hold, with arrays of a kind."""
    whole = np.random.default_rng(2).integers(-9, 9, (20, 23))
    sh = whole[:, 11:].reshape(20, 4, 3)
    return GaussianScene(
        kind(whole[:, :3]), kind(whole[:, 3:6]), kind(whole[:, 6:10]), kind(whole[:, 10]), kind(sh)
    )


@pytest.mark.parametrize(
    "kind",
    [
        lambda part: part.astype(np.float16),
        lambda part: part,
        lambda part: part.astype(">f8"),
        lambda part: part.tolist(),
    ],
    ids=["float16", "integers", "other byte order", "lists"],
)
def test_other_types_become_those_of_the_scene(kind: Callable[[NDArray[Any]], Any]) -> None:
    """Sums of float16 overflow, and integers have no room for fractions."""
    scene = made(kind)
    types = {name: array.dtype for name, array in scene.arrays().items()}
    assert types.pop("positions") == np.float64
    assert set(types.values()) == {np.dtype(np.float32)}
    plain = made(lambda part: part.astype(np.float32))
    for name, array in scene.arrays().items():
        np.testing.assert_array_equal(array, plain.arrays()[name])


def test_arrays_of_the_types_of_the_scene_are_taken_as_they_are() -> None:
    """What is written into them is written into the scene: nothing is copied."""
    positions = np.zeros((2, 3))
    rows = np.zeros((2, 7), np.float32)
    scene = GaussianScene(positions, rows[:, :3], rows[:, 3:], rows[:, 0], np.zeros((2, 1, 3), np.float32))
    assert scene.positions is positions
    assert np.shares_memory(scene.rotations, rows)
