"""Export of a trained scene as the integers of a file (SPEC §6, §7). Nothing is chosen again.

A table has at most 4096 symbols (SPEC §8.1, §8.3). Only a run that hardly prices bytes makes cells too narrow for that;
training goes on with wider ones, so that its pictures stay those of the file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from reference_encoder.rdo.lattice import assign_tiles, default_tile_size
from reference_encoder.training.anchors import NETWORKS, SLOTS
from reference_encoder.training.layers import coarse
from reference_encoder.training.state import WEIGHT_BITS, State
from reference_encoder.training.vq_features import ExportedLatents, export_latents
from scarfmt.arrays import I64, U64
from scarfmt.blocks.mlp import Linear, QuantisedMlp
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import HeaderFields, Tile
from scarfmt.container.morton import interleave
from scarfmt.container.schema import ColourSpace, CoordinateFrame, Profile, Stream
from scarfmt.entropy.rans import MAX_ALPHABET
from scarfmt.scene.model import Channel, LayerRow, SceneModel

_WIDER = math.log(1.25)


@torch.no_grad()
def fit_table_limits(state: State) -> int:
    """Widen cells, by steps of a quarter, until the first-step integers of each component fit a table.

    Args:
        state: its `log_widths` and `log_offset_widths` change.

    Returns:
        How many components have wider cells than before.
    """
    a = state.anchors
    opened = a.first < state.plan.count
    rows = opened.any(dim=1).nonzero()[:, 0]
    values = [a.scaling[rows]] + ([] if state.vectors else [a.latent[rows]])
    widened = _widen(torch.cat(values, dim=1), state.log_widths, state.plan.steps[-1] - 1)
    return widened + _widen(a.offsets[opened], state.log_offset_widths, 0)


def _widen(values: Tensor, log_widths: Tensor, steps: int) -> int:
    """(n, d) values in (d,) cells that are finer than those of the first step by so many ternary `steps`."""
    widened = 0
    for component, column in enumerate(values.T):
        before = float(log_widths[component])
        while _count_different(column, log_widths[component], steps) > MAX_ALPHABET:
            log_widths[component] += _WIDER
        widened += float(log_widths[component]) > before
    return widened


def _count_different(column: Tensor, log_width: Tensor, steps: int) -> int:
    """How many different integers the first step has."""
    finest = torch.round(column / torch.exp(log_width))[:, None]
    return len(torch.unique(coarse(finest, torch.full_like(column, steps, dtype=torch.long))))


def cut_tiles(codes: U64, bits: int, most: int | None = None) -> tuple[tuple[Tile, ...], I64, U64]:
    """The largest cubes that hold few enough of n >= 1 anchors.

    Args:
        codes: (n,) uint64 Morton codes of `bits` bits an axis.
        most: anchors of a tile, None for what is usual.

    Returns:
        The tile table, (n,) int64 tile of each anchor, and (n,) uint64 local Morton codes.
    """
    depth, prefix, tile = assign_tiles(codes, bits, most or default_tile_size(len(codes)))
    own_bits = (3 * (bits - depth)).astype(np.uint64)
    local = codes & ((np.uint64(1) << own_bits) - np.uint64(1))[tile]
    return tuple(Tile(int(d), 0, int(p)) for d, p in zip(depth, prefix, strict=True)), tile, local


def tile_rows(tile: I64, codes: U64, classes: I64) -> list[I64]:
    """Rows of the anchors of each tile in the order of the file: by class, then code."""
    order = np.lexsort((codes, classes, tile))
    return np.split(order, np.cumsum(np.bincount(tile))[:-1])


def slot_layers(state: State) -> Tensor:
    """(N, K) int64 layer, from 1, that turns each slot on; 0 for never."""
    first = state.anchors.first
    return torch.where(first < state.plan.count, first + 1, 0)


@torch.no_grad()
def quantise_scene(state: State, metadata: Mapping[str, Any], source_count: int) -> QuantisedScene:
    """All integers of the file, as training rounds them.

    Args:
        state: slots, widths, values, networks.
        metadata: JSON-able annotations.
        source_count: of anchors before any was left out.
    """
    opened = slot_layers(state)
    visible = (opened > 0).any(dim=1).nonzero()[:, 0]
    layers = opened[visible].cpu().numpy()
    classes = np.where(layers > 0, layers, state.plan.count + 1).min(axis=1) - 1
    missing = state.missing(visible, state.plan.count - 1)
    classes, rows = _without_gaps(classes, state)
    lattice, fields = _header(state, visible, source_count)
    tiles, tile, codes = cut_tiles(interleave(lattice), fields.lattice_bits)
    values, offsets = (part.int().cpu().numpy() for part in state.integers(visible, missing))
    finals = [values[:, :6]] if state.vectors else [values[:, :6], values[:, 6:]]
    finals.append((offsets * (layers > 0)[:, :, None]).astype(np.int32))
    model = SceneModel(Profile.ANCHOR, SLOTS, _channels(state), rows)
    exported = _export(state, visible, classes, model)

    def content(here: I64) -> TileContent:
        made = TileContent.empty(model, len(here))
        made.codes, made.classes, made.slot_layers = codes[here], classes[here], layers[here]
        made.values = [final[here] for final in finals]
        if exported is not None:
            made.indices = exported.indices[here]
        return made

    return QuantisedScene(
        fields=fields,
        model=model,
        tiles=tiles,
        contents=tuple(content(here) for here in tile_rows(tile, codes, classes)),
        codebooks=None if exported is None else exported.codebooks,
        decoder=QuantisedMlp((_linear(state.networks.decoder),)) if exported is None else exported.decoder,
        scene_mlps=tuple(
            QuantisedMlp((_linear(state.networks.hidden[name]), _linear(state.networks.output[name])))
            for name in NETWORKS
        ),
        metadata=dict(metadata),
    )


def _export(state: State, visible: Tensor, classes: I64, model: SceneModel) -> ExportedLatents | None:
    """Codewords and indices, None where latents are sent number by number."""
    if state.vectors is None:
        return None
    features, latent = state.vectors, state.anchors.latent.detach()[visible]
    received = torch.from_numpy(model.stages(len(model.layers), classes)).to(latent.device)
    made = export_latents(features.quantiser, latent, features.codes(latent), received, features.coordinates)
    features.coordinates = made.coordinates
    return made


def _without_gaps(classes: I64, state: State) -> tuple[I64, tuple[LayerRow, ...]]:
    """Classes, one a layer in which some anchor appears first, and the layer table."""
    used = np.unique(classes)
    rows = []
    for layer in range(state.plan.count):
        present = [int(each) for each in used if each <= layer] or [int(used[0])]
        stages = 0 if state.vectors is None else state.vectors.stages[layer]
        steps = [state.plan.steps_of(layer, each) for each in present]
        channels = tuple((n, n, 1) if state.vectors is None else (n, 1) for n in steps)
        rows.append(LayerRow((stages,) * len(present), channels))
    return np.searchsorted(used, classes), tuple(rows)


def _header(state: State, visible: Tensor, source_count: int) -> tuple[Any, HeaderFields]:
    """Lattice points from 0 as (n, 3) uint64, and the header that puts them where they were."""
    points = state.anchors.lattice[visible].cpu().numpy()
    low = points.min(axis=0)
    bits = max(1, int((points - low).max()).bit_length())
    voxel = state.frame.voxel
    # The centre of a cell is where a position is (SPEC §9.1).
    x, y, z = (float(o + voxel * (p - 0.5)) for o, p in zip(state.frame.origin.tolist(), low, strict=True))
    fields = HeaderFields(
        Profile.ANCHOR, 0, SLOTS, bits, (x, y, z), voxel, source_count, CoordinateFrame.RDF, ColourSpace.SRGB
    )
    return (points - low).astype(np.uint64), fields


def _channels(state: State) -> tuple[Channel, ...]:
    """Channels with the cells of first steps."""
    widths = (torch.exp(state.log_widths) * 3.0 ** (state.plan.steps[-1] - 1)).double().tolist()
    offset_widths = torch.exp(state.log_offset_widths).double().tolist()
    latent = () if state.vectors else (Channel(Stream.LATENT, tuple(widths[6:])),)
    return (Channel(Stream.SCALE, tuple(widths[:6])), *latent, Channel(Stream.OFFSETS, tuple(offset_widths)))


def _linear(layer: nn.Module) -> Linear:
    assert isinstance(layer, nn.Linear)
    return Linear.quantise(layer.weight.cpu().numpy(), layer.bias.cpu().numpy(), bits=WEIGHT_BITS)
