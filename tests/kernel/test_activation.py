"""Compiled activation and world positions: within the tolerance of SPEC §9.5, and exact where §9.1 says so."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzz.testing.scenes import random_scene
from reference_decoder.decode import decode
from reference_decoder.dequantise import positions
from reference_decoder.explicit import empty_scene
from scarfmt.codecs.channels import cell_widths
from scarfmt.coding.writer import write_scene
from scarfmt.container.directory import Tile, TileFrame
from scarfmt.container.morton import deinterleave
from scarfmt.container.schema import Stream
from scarfmt.kernel.activation import KernelActivation, world_positions
from scarfmt.scene.activation import activated
from scarfmt.scene.model import Channel, ContextRule, Lattice
from tests.kernel.samples import SEEDS, library, needs_kernel, same

pytestmark = needs_kernel
TOLERANCE = 1e-5
NOTHING = np.zeros((1, 0), np.int16), np.zeros(1, np.int64)


@settings(deadline=None, max_examples=60)
@given(SEEDS, st.integers(0, 40), st.integers(0, 21), st.integers(0, 11), st.booleans())
def test_world_positions(seed: int, count: int, bits: int, shift: int, moved: bool) -> None:
    """The bits of the definition: no multiplication is fused with a sum."""
    rng = np.random.default_rng(seed)
    lattice = Lattice(tuple(rng.normal(0, 1e3, 3).tolist()), float(np.exp(rng.normal(-4, 3))), 32)
    depth = 32 - bits - shift
    tile = Tile(depth, shift, int(rng.integers(0, 1 << min(3 * depth, 62))))
    codes = rng.integers(0, 1 << 3 * bits, count, dtype=np.uint64)
    channel = Channel(Stream.POSITION_RESIDUAL, (1 / 3, 0.3, 0.2), (ContextRule(),) * 3)
    values, steps = rng.integers(-1, 2, (count, 3)).astype(np.int32), rng.integers(0, 4, count)
    corner = tuple(int(c) << (32 - depth) for c in deinterleave(np.array([tile.prefix], np.uint64))[0])
    out = np.empty((count, 3))
    given_residuals = (channel, values, steps) if moved else None
    world_positions(library(), lattice, TileFrame(bits, shift, corner), codes, given_residuals, out)
    apart = values * cell_widths(channel.first_width, steps) if moved else None
    assert same(out, positions(lattice, tile, codes, apart))


@settings(deadline=None, max_examples=25)
@given(SEEDS, st.integers(0, 3))
def test_gaussians_are_within_tolerance(seed: int, degree: int) -> None:
    """Gaussians agree for scenes with and without colour, stages and refinements, after every layer."""
    data = write_scene(random_scene(seed % 1000, anchors=50, sh_degree=degree))
    found = decode(data, backend="kernel")
    for layers in range(1, found.layers + 1):
        found = decode(data, backend="kernel", layers=layers)
        scene: Any = found.scene
        exact: Any = found.activated(np.float64)
        for name in ("log_scales", "rotations", "opacity_logits", "sh"):
            a, b = getattr(scene, name), getattr(exact, name)
            assert a.dtype == np.float32
            assert (np.abs(a - b) <= TOLERANCE * np.maximum(1, np.abs(b))).all(), name


@settings(deadline=None, max_examples=60)
@given(st.integers(-150, 127), SEEDS)
def test_rotations_of_any_size(exponent: int, seed: int) -> None:
    """Coordinates up to 2^127 and twists of many turns; where a series ends, the library's functions go on."""
    rng = np.random.default_rng(seed)
    scale = np.array([2.0**exponent, 2.0**exponent, min(2.0**exponent, 1e4)])
    rotation = np.clip(rng.normal(0, 1, (37, 3)) * scale, -1.7e38, 1.7e38).astype(np.float32)
    opacity = (-np.exp(rng.normal(0, 6, (37, 1)))).astype(np.float32)
    models = replace(decode(write_scene(random_scene(2))).models, codebooks=None, decoder=None)
    values = {Stream.ROTATION: rotation, Stream.OPACITY: opacity, Stream.SCALE: np.zeros((37, 3), np.float32)}
    out = empty_scene(37, 0)
    KernelActivation(models, library()).fill(out, values, np.zeros((37, 0), np.int16), np.zeros(37, np.int64))
    wide = {stream: array.astype(np.float64) for stream, array in values.items()}
    quaternions, logits, _ = activated(wide, 37, np.float64)
    assert (np.abs(out.rotations - quaternions) <= TOLERANCE).all()
    assert (np.abs(out.opacity_logits - logits) <= TOLERANCE * np.maximum(1, np.abs(logits))).all()
    assert not out.sh.any()


def test_neighbours_do_not_matter() -> None:
    """An anchor's Gaussian is the same by itself, in a block of others, and beside one whose twist is large."""
    rng = np.random.default_rng(5)
    models = replace(decode(write_scene(random_scene(2))).models, codebooks=None, decoder=None)
    activation, count = KernelActivation(models, library()), 40
    values = {stream: rng.normal(0, 1, (count, n)).astype(np.float32) for stream, n in
              ((Stream.ROTATION, 3), (Stream.OPACITY, 1), (Stream.COLOUR, 3))}  # fmt: skip
    values[Stream.OPACITY] = -np.abs(values[Stream.OPACITY])
    whole = empty_scene(count, 1)
    activation.fill(whole, values, np.zeros((count, 0), np.int16), np.zeros(count, np.int64))
    for i in range(count):
        alone = empty_scene(1, 1)
        activation.fill(alone, {k: v[i : i + 1] for k, v in values.items()}, *NOTHING)
        for name in ("rotations", "opacity_logits", "sh"):
            assert same(getattr(alone, name)[0], getattr(whole, name)[i]), name


def test_arrays_that_do_not_fit_are_refused() -> None:
    """Memory is never read as what it is not, or past its end."""
    found = decode(write_scene(random_scene(1)), backend="kernel")
    activation, count = KernelActivation(found.models, library()), len(found)
    assert found.indices is not None
    for values in ({Stream.ROTATION: np.zeros((count, 2), np.float32)}, {Stream.OPACITY: np.zeros((count, 1))}):
        with pytest.raises(TypeError):
            activation.fill(empty_scene(count, 1), values, found.indices, found.stages)
    with pytest.raises(TypeError):
        activation.fill(empty_scene(count, 1), {}, found.indices[:-1], found.stages[:-1])
