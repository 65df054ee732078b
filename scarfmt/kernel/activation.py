"""Compiled activation of explicit anchors (SPEC §9.3-9.5) and world positions (SPEC §9.1)."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64, I16, I32, I64, U64
from scarfmt.codecs.channels import width_table
from scarfmt.container.directory import TileFrame
from scarfmt.container.schema import Stream
from scarfmt.kernel import structs
from scarfmt.kernel.memory import address, shaped
from scarfmt.kernel.scratch import SCRATCH
from scarfmt.kernel.values import kernel_values, planes
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.model import Channel, Lattice

if TYPE_CHECKING:
    from scarfmt.coding.models import SceneModels
    from scarfmt.coding.tile import TileContent

_BLOCK = 16
# Of no columns: as many as the latent has.
_ATTRIBUTES = (
    ("rotation", Stream.ROTATION, 3),
    ("opacity", Stream.OPACITY, 1),
    ("colour", Stream.COLOUR, 3),
    ("latent", Stream.LATENT, 0),
)


class KernelActivation:
    """Makes Gaussians of exact values. Threads may share one.

    To be kept with the models: :meth:`scarfmt.kept.Keeper.kept`.

    Args:
        models: codebooks and latent decoder.
        library: the compiled library.
    """

    def __init__(self, models: SceneModels, library: ctypes.CDLL) -> None:
        self._library, self._model, self._kept = library, models.model, list[NDArray[Any]]()
        self._struct = struct = structs.Activation()
        decoder, books = models.decoder, models.codebooks
        layers = decoder.layers if decoder is not None else ()
        struct.layers, struct.latent_width = len(layers), decoder.inputs if decoder is not None else 0
        struct.widest = max([1, struct.latent_width, *(len(layer.biases) for layer in layers)])
        for out, layer in zip(struct.layer, layers, strict=False):
            out.outputs, out.inputs = layer.weights.shape
            out.weights, out.biases = self._array(layer.matrix, np.float64), self._array(layer.biases, np.float64)
        for number, book in enumerate((books.coarse, books.residual) if books is not None else ()):
            struct.books[number] = self._array(book, np.float32)

    def put_tile(self, out: GaussianScene, lattice: Lattice, frame: TileFrame, content: TileContent) -> None:
        """Fill in all of `out`, float32 but for positions, from the integers of a tile (SPEC §9.1-9.5)."""
        model, residuals = self._model, None
        values: dict[Stream, F32] = {}
        for index, channel in enumerate(model.channels):
            steps, integers = model.steps(len(model.layers), index, content.classes), content.values[index]
            if channel.stream == Stream.POSITION_RESIDUAL:
                residuals = channel, integers, steps
                continue
            scales = channel.stream == Stream.SCALE
            rows = out.log_scales if scales else SCRATCH.array(channel.stream.name, integers.shape, np.float32)
            kernel_values(self._library, integers, steps, width_table(channel.first_width), rows)
            values[channel.stream] = rows
        world_positions(self._library, lattice, frame, content.codes, residuals, out.positions)
        self.fill(out, values, content.indices, model.stages(len(model.layers), content.classes))

    def _array(self, array: NDArray[Any], dtype: type) -> int:
        self._kept.append(np.ascontiguousarray(array, dtype))
        return int(self._kept[-1].ctypes.data)

    def fill(self, out: GaussianScene, values: Mapping[Stream, F32], indices: I16, stages: I64) -> None:
        """Fill in rotations, logits and spherical harmonics of n anchors, float32 rows of larger arrays.

        Args:
            out: room for n Gaussians.
            values: exact channel values, (n, components) float32; those that are not there count as 0.
            indices: (n, M) int16 codeword numbers.
            stages: (n,) int64 stages received.
        """
        count = len(out)
        struct = structs.Activation.from_buffer_copy(self._struct)
        struct.count, struct.coefficients, struct.stages = count, out.sh.shape[1], indices.shape[1]
        for name, stream, columns in _ATTRIBUTES:
            # Before a layer needs the latent decoder, refinements of latents make nothing.
            width = columns or int(struct.latent_width)
            if stream in values and width:
                setattr(struct, name, shaped(values[stream], np.float32, (count, width)))
        struct.indices = shaped(indices, np.int16, indices.shape)
        struct.received = shaped(stages, np.int64, (count,))
        struct.quaternions = shaped(out.rotations, np.float32, (count, 4))
        struct.logits = shaped(out.opacity_logits, np.float32, (count,))
        struct.harmonics = shaped(out.sh, np.float32, (count, out.sh.shape[1], 3))
        memory = SCRATCH.at("activation", 2 * _BLOCK * 8 * struct.widest)
        self._library.scar_activate(ctypes.byref(struct), memory)


def world_positions(
    library: ctypes.CDLL,
    lattice: Lattice,
    frame: TileFrame,
    codes: U64,
    residuals: tuple[Channel, I32, I64] | None,
    out: F64,
) -> None:
    """Put the world positions of a tile's anchors into `out`, (n, 3) float64 rows (SPEC §9.1).

    Args:
        lattice, frame: of the scene and of the tile.
        codes: (n,) uint64 local Morton codes.
        residuals: the channel of residuals, checked to be within reach, its (n, 3) int32 values and (n,) steps.
    """
    struct = structs.Frame(lattice.origin, lattice.voxel, frame.corner, frame.shift)
    given: tuple[int | None, int, int | None] = None, 0, None
    if residuals is not None:
        channel, values, steps = residuals
        # Named, and so kept until the call is over, whatever becomes of the table that others are given.
        widths = width_table(channel.first_width)
        struct.widths = address(widths, np.float64)
        plane = planes(values)
        given = shaped(plane, np.int32, (3, len(codes))), len(codes), shaped(steps, np.int64, codes.shape)
    arrays = shaped(codes, np.uint64, codes.shape), *given, len(codes), shaped(out, np.float64, (len(codes), 3))
    library.scar_world_positions(ctypes.byref(struct), *arrays)
