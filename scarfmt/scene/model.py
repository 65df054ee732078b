"""The properties of a scene that a file states before any anchor: channels, classes, layers, lattice (SPEC §6).

A *class* is a set of anchors of like importance. Every anchor belongs to one; the layer table says, per
class, how many RVQ stages and how many ternary steps of each channel it has after each layer. That one
table expresses progressive refinement, late appearance and "stop refining what nobody can see".
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import I64
from scarfmt.container.schema import Profile, Stream
from scarfmt.errors import Malformed
from scarfmt.scene.streams import CONTEXT_STREAMS, PREDICTED_STREAMS, STREAMS, Codec, components, needed

MAX_CLASSES = 15
MAX_CHANNELS = 8
MAX_COMPONENTS = 64
MAX_STAGES = 8
MAX_STEPS = 20
"""3^19 ternary cells span more than 2^30: enough to refine any binary32 channel."""


MAX_PASSES_LOG2 = 3
MAX_DEPTHS = 4
MAX_OCCUPANCY = 65535

MAX_FIRST_WIDTH = 2.0**96
"""With |v| < 2^31 it keeps every channel value a finite binary32, whatever symbols are decoded."""


@dataclass(frozen=True)
class Channel:
    """A quantised attribute (SPEC §6.4): value = v * first_width / 3^(n - 1) after n ternary steps.

    Attributes:
        stream: the sub-stream that carries it, one of `streams.CHANNEL_STREAMS`.
        first_width: one a component: width of the cells of the first step, in units of the attribute; above 0, at
            most 2^96; rounded to float32.
    """

    stream: Stream
    first_width: tuple[float, ...]

    def __post_init__(self) -> None:
        with np.errstate(over="ignore"):
            object.__setattr__(self, "first_width", tuple(np.array(self.first_width, np.float32).tolist()))

    @property
    def components(self) -> int:
        """Number of components."""
        return len(self.first_width)

    @property
    def per_slot(self) -> bool:
        """Whether every slot has values of its own, sent once, when it is turned on (SPEC §7.7)."""
        return STREAMS[self.stream].codec is Codec.SLOT_CHANNEL


@dataclass(frozen=True)
class LayerRow:
    """State of every class after one layer (SPEC §6.5), and how its indices are coded.

    Attributes:
        stages: (classes,) RVQ stages received so far.
        steps: (classes, channels) ternary steps received so far, 0 = nothing yet.
        neural: whether the index network, not static tables, codes INDICES in this layer (SPEC §10.4).
    """

    stages: tuple[int, ...]
    steps: tuple[tuple[int, ...], ...]
    neural: bool = False

    @property
    def class_count(self) -> int:
        """Classes that have appeared by this layer."""
        return len(self.stages)


@dataclass(frozen=True)
class Lattice:
    """The place of integer positions in the world (SPEC §6.2).

    Attributes:
        origin: (3,) world position of lattice point 0.
        voxel: world length of a lattice step.
        bits: lattice bits per axis, 1..32.
    """

    origin: tuple[float, float, float]
    voxel: float
    bits: int


@dataclass(frozen=True)
class DecodedContext:
    """How the values already decoded are summed up for predictors and the index network (SPEC §10.2).

    Attributes:
        passes_log2: a group of symbols is coded in this many passes, plus one; 0..3.
        occupancies: anchors a cell shall hold on average, one number a depth, coarse first: strictly descending,
            1..65535.
    """

    passes_log2: int = 0
    occupancies: tuple[int, ...] = ()

    def check(self) -> None:
        """Check SPEC §10.2.

        Raises:
            Malformed: ``bad-context``.
        """
        targets = self.occupancies
        falls = all(a > b for a, b in pairwise(targets))
        sane = 0 <= self.passes_log2 <= MAX_PASSES_LOG2 and len(targets) <= MAX_DEPTHS
        if not (sane and falls and all(1 <= target <= MAX_OCCUPANCY for target in targets)):
            message = f"{self.passes_log2} and {targets} are no passes and occupancies (SPEC §10.2)"
            raise Malformed("bad-context", message, field="context")


Opening = tuple[tuple[Channel, ...], DecodedContext]
"""The fields that only the LAYER block of layer 1 has."""


@dataclass(frozen=True)
class SceneModel:
    """Everything the sub-stream codecs need to know.

    Attributes:
        profile: explicit, or anchor: with masks and offsets.
        slots: K, Gaussian slots per anchor.
        channels: in coding order.
        layers: one row a layer.
        context: what predictors and the index network look at.
    """

    profile: Profile
    slots: int
    channels: tuple[Channel, ...]
    layers: tuple[LayerRow, ...]
    context: DecodedContext = DecodedContext()

    def first_new_class(self, layer: int) -> int:
        """Number of classes present before `layer` (1-based)."""
        return self.layers[layer - 2].class_count if layer > 1 else 0

    @cached_property
    def _stage_tables(self) -> list[I64]:
        return [_pad([[s] for s in row.stages]) for row in self.layers]

    @cached_property
    def _step_tables(self) -> list[I64]:
        return [_pad(row.steps) for row in self.layers]

    def stages(self, layer: int, classes: I64) -> I64:
        """(n,) RVQ stages of anchors of `classes` after `layer`; 0 before their class appears."""
        if layer == 0:
            return np.zeros(len(classes), np.int64)
        return self._stage_tables[layer - 1].take(classes)

    def steps(self, layer: int, channel: int, classes: I64) -> I64:
        """(n,) ternary steps of `channel` after `layer`; 0 before the class appears."""
        if layer == 0:
            return np.zeros(len(classes), np.int64)
        return self._step_tables[layer - 1][:, channel].take(classes)

    @property
    def max_stages(self) -> int:
        """RVQ stages of the best class after the last layer."""
        return max(self.layers[-1].stages)

    def check(self) -> None:
        """Check SPEC §6.4-6.5.

        Raises:
            Malformed: ``bad-layer-table`` or ``bad-channel``.
        """
        check_channels(self.channels, self.profile)
        self.context.check()
        before: LayerRow | None = None
        for row in self.layers:
            check_row(row, before, len(self.channels))
            if row.neural and not max(row.stages):
                raise _bad_table("entropy mode 1 is for layers by which a class has a stage")
            before = row
        if self.profile == Profile.ANCHOR:
            self._check_anchor_rows()

    def _check_anchor_rows(self) -> None:
        # OFFSETS is the last channel: streams ascend.
        if any(steps[-1] != 1 for row in self.layers for steps in row.steps):
            raise _bad_table("offsets come in one step, with their slot: their steps are always 1")
        if first_layers(self)[2] != 1:
            raise _bad_table("the anchor profile needs a stage or a latent step in layer 1: there is no feature else")

    @cached_property
    def attributes(self) -> tuple[int, ...]:
        """Indices of the channels whose values are context for others (SPEC §10.2)."""
        return tuple(index for index, channel in enumerate(self.channels) if channel.stream in CONTEXT_STREAMS)

    @cached_property
    def predicted(self) -> tuple[int, ...]:
        """Indices of the channels that may have predictors (SPEC §10.3)."""
        return tuple(index for index, channel in enumerate(self.channels) if channel.stream in PREDICTED_STREAMS)

    def channel_index(self, stream: Stream) -> int | None:
        """Index of the channel that `stream` carries, None without it."""
        return next((index for index, channel in enumerate(self.channels) if channel.stream == stream), None)


def first_layers(model: SceneModel) -> tuple[int | None, int | None, int | None]:
    """The layers (1-based) in which codebook 0, codebook 1 and the decoder are first needed, None if never."""
    latent = model.channel_index(Stream.LATENT)
    found: list[int | None] = [None, None, None]
    for number, row in enumerate(model.layers, start=1):
        stages = max(row.stages)
        refined = latent is not None and any(steps[latent] for steps in row.steps)
        for item, wanted in enumerate((stages >= 1, stages >= 2, stages >= 1 or refined)):
            if found[item] is None and wanted:
                found[item] = number
    return found[0], found[1], found[2]


def first_neural_layer(model: SceneModel) -> int | None:
    """The first layer (1-based) of entropy mode 1, None without one."""
    return next((number for number, row in enumerate(model.layers, start=1) if row.neural), None)


def _pad(rows: object) -> I64:
    """Rows of the classes present, then zeros for those still to come."""
    table = np.array(rows, np.int64)
    return np.concatenate([table, np.zeros((MAX_CLASSES + 1 - len(table), table.shape[1]), np.int64)])


def check_channels(channels: tuple[Channel, ...], profile: Profile) -> None:
    """Check the channel table (SPEC §6.4).

    Raises:
        Malformed: ``bad-channel`` for streams that do not ascend or that the profile does not have, a wrong number
            of components, or a first width out of range.
    """
    streams = [channel.stream for channel in channels]
    sizes = components(profile)
    if streams != sorted(set(streams)) or not set(streams) <= set(sizes):
        raise _bad_channel(f"channels {streams} must ascend and belong to the profile (SPEC §6.4)")
    if not needed(profile) <= set(streams):
        raise _bad_channel("a scene needs scales, and in the anchor profile offsets (SPEC §6.4)")
    for channel in channels:
        name, expected = channel.stream.name, sizes[channel.stream]
        if not 1 <= channel.components <= MAX_COMPONENTS or expected not in (None, channel.components):
            raise _bad_channel(f"{name} has {channel.components} components, not {expected or '1..64'} (SPEC §6.4)")
        if not all(0 < width <= MAX_FIRST_WIDTH for width in channel.first_width):
            raise _bad_channel(f"{name}: first widths must be above 0 and at most 2^96 (SPEC §6.4)")


def _bad_channel(message: str) -> Malformed:
    return Malformed("bad-channel", message, field="channels")


def check_row(row: LayerRow, before: LayerRow | None, channels: int) -> None:
    """Check one layer row against the one before (SPEC §6.5): nothing is ever taken back."""
    fits = (
        1 <= row.class_count <= MAX_CLASSES
        and len(row.steps) == row.class_count
        and all(0 <= stages <= MAX_STAGES for stages in row.stages)
        and all(len(steps) == channels and all(0 <= n <= MAX_STEPS for n in steps) for steps in row.steps)
    )
    if fits and before is not None:
        fits = row.class_count >= before.class_count
        fits &= all(new >= old for new, old in zip(row.stages, before.stages, strict=False))
        for new, old in zip(row.steps, before.steps, strict=False):
            fits &= all(a >= b for a, b in zip(new, old, strict=True))
    if not fits:
        raise _bad_table("a layer row is out of range or takes something back")


def _bad_table(message: str) -> Malformed:
    return Malformed("bad-layer-table", f"{message} (SPEC §6.5)", field="layer")


MAX_CODEWORDS = 4096
MAX_LATENT = 64


@dataclass(frozen=True)
class Codebooks:
    """The two codebooks; an empty one has shape (0, d).

    Attributes:
        coarse: (n1, d) int64 codewords of stage 1.
        residual: (n2, d) int64 codewords of later stages.
    """

    coarse: I64
    residual: I64

    @property
    def dimension(self) -> int:
        """d, latent dimensions."""
        return int(self.coarse.shape[1])

    @property
    def sizes(self) -> tuple[int, int]:
        """Codewords in each book."""
        return len(self.coarse), len(self.residual)

    def latents(self, indices: NDArray[np.integer[Any]], stages: I64, columns: int | None = None) -> I64:
        """(n, d) int64 sums of the codewords of each anchor's first `stages` indices (SPEC §9.2).

        Args:
            indices: (n, M) int64.
            stages: (n,) int64 stages received, 0..M.
            columns: how many leading dimensions are wanted, None for all.
        """
        z = np.zeros((len(indices), self.dimension if columns is None else columns), np.int64)
        for stage in range(indices.shape[1]):
            chosen = np.flatnonzero(stages > stage)
            book = (self.residual if stage else self.coarse)[:, : z.shape[1]]
            if len(chosen) == len(z):
                z += book.take(indices[:, stage], axis=0)
            elif len(chosen):
                z[chosen] += book.take(indices[chosen, stage], axis=0)
        return z
