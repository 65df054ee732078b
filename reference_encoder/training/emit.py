"""Export of a trained scene as the integers of a file. Nothing is chosen again (SPEC §6, §7)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from reference_encoder.decide.contexts import choose_rules, enough_anchors
from reference_encoder.training.anchors import NETWORKS, SLOTS
from reference_encoder.training.fixed_latents import Exported, export
from reference_encoder.training.layers import coarse
from reference_encoder.training.state import WEIGHT_BITS, State
from reference_encoder.training.tiles import Tiles
from scarfmt.arrays import I64
from scarfmt.blocks.mlp import Linear, QuantisedMlp
from scarfmt.coding.tile import TileContent, first_values
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import HeaderFields
from scarfmt.container.morton import interleave
from scarfmt.container.schema import ColourSpace, CoordinateFrame, Profile, Stream
from scarfmt.scene.model import Channel, ContextRule, LayerRow, SceneModel


def slot_layers(state: State) -> Tensor:
    """(N, K) int64 layer, from 1, that turns each slot on; 0 for never."""
    first = state.anchors.first
    return torch.where(first < state.plan.count, first + 1, 0)


@torch.no_grad()
def quantised_scene(state: State, metadata: Mapping[str, Any], source_count: int) -> QuantisedScene:
    """All integers of the file, as training rounds them.

    Args:
        state: slots, widths, values, networks.
        metadata: JSON-able annotations.
        source_count: of anchors before any was left out.
    """
    opened = slot_layers(state)
    kept = (opened > 0).any(dim=1).nonzero()[:, 0]
    layers = opened[kept].cpu().numpy()
    classes = np.where(layers > 0, layers, state.plan.count + 1).min(axis=1) - 1
    missing = state.missing(kept, state.plan.count - 1)
    classes, rows = _without_gaps(classes, state)
    lattice, fields = _header(state, kept, source_count)
    tiles = Tiles.of(interleave(lattice), fields.lattice_bits)
    values, offsets = integers(state, kept, missing)
    finals = [*values, (offsets * (layers > 0)[:, :, None]).astype(np.int32)]
    model = SceneModel(Profile.ANCHOR, SLOTS, _channels(state, finals, classes, missing.cpu()), rows)
    exported = _exported(state, kept, classes, model)

    def content(here: I64) -> TileContent:
        made = TileContent.empty(model, len(here))
        made.codes, made.classes, made.slot_layers = tiles.codes[here], classes[here], layers[here]
        made.values = [final[here] for final in finals]
        made.first = first_values(model, made)
        if exported is not None:
            made.indices = exported.indices[here]
        return made

    return QuantisedScene(
        fields=fields,
        model=model,
        tiles=tiles.tiles,
        contents=tuple(content(here) for here in tiles.anchors(classes)),
        codebooks=None if exported is None else exported.codebooks,
        decoder=QuantisedMlp((_linear(state.networks.decoder),)) if exported is None else exported.decoder,
        scene_mlps=tuple(
            QuantisedMlp((_linear(state.networks.hidden[name]), _linear(state.networks.output[name])))
            for name in NETWORKS
        ),
        metadata=dict(metadata),
    )


def _exported(state: State, kept: Tensor, classes: I64, model: SceneModel) -> Exported | None:
    """Codewords and indices, None where latents are sent number by number."""
    if state.vectors is None:
        return None
    latent = state.anchors.latent.detach()[kept]
    received = torch.from_numpy(model.stages(len(model.layers), classes)).to(latent.device)
    made = export(state.vectors.quantiser, latent, state.vectors.codes(latent), received, state.vectors.coordinates)
    state.vectors.coordinates = made.coordinates
    return made


def integers(state: State, rows: Tensor, missing: Tensor) -> tuple[list[Any], Any]:
    """Integers at the last step, int32: of scalings (n, 6) and, if they are sent, latents (n, d); offsets (n, K, 3).

    Args:
        state: values and widths.
        rows: which anchors.
        missing: (n,) ternary steps of each before the finest.
    """
    a = state.anchors
    widths, offset_widths = torch.exp(state.log_widths), torch.exp(state.log_offset_widths)
    offsets = torch.round(a.offsets[rows] / offset_widths).int().cpu().numpy()
    sent = [(a.scaling[rows], widths[:6])] + ([] if state.vectors else [(a.latent[rows], widths[6:])])
    values = [coarse(torch.round(value / width), missing).int().cpu().numpy() for value, width in sent]
    return values, offsets


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


def _header(state: State, kept: Tensor, source_count: int) -> tuple[Any, HeaderFields]:
    """Lattice points from 0 as (n, 3) uint64, and the header that puts them where they were."""
    points = state.anchors.lattice[kept].cpu().numpy()
    low = points.min(axis=0)
    bits = max(1, int((points - low).max()).bit_length())
    voxel = state.frame.voxel
    # The centre of a cell is where a position is (SPEC §9.1).
    x, y, z = (float(o + voxel * (p - 0.5)) for o, p in zip(state.frame.origin.tolist(), low, strict=True))
    fields = HeaderFields(
        Profile.ANCHOR, 0, SLOTS, bits, (x, y, z), voxel, source_count, CoordinateFrame.RDF, ColourSpace.SRGB
    )
    return (points - low).astype(np.uint64), fields


def _channels(state: State, finals: list[Any], classes: I64, missing: Tensor) -> tuple[Channel, ...]:
    """Channels with the cells of first steps, and the contexts that take fewest bits; `missing` as of `integers`."""
    steps = state.plan.steps[-1] - 1
    widths = (torch.exp(state.log_widths) * 3.0**steps).double().tolist()
    offset_widths = torch.exp(state.log_offset_widths).double().tolist()
    streams = (Stream.SCALE, Stream.LATENT)[: len(finals) - 1]
    some = enough_anchors(len(classes))
    firsts = [coarse(torch.from_numpy(v[some]).double(), steps - missing[some]).long().numpy() for v in finals[:-1]]
    rules = choose_rules(streams, firsts, classes[some], len(classes))
    cells = (widths[:6], widths[6:])
    return (
        *(Channel(*each) for each in zip(streams, map(tuple, cells[: len(streams)]), rules, strict=True)),
        Channel(Stream.OFFSETS, tuple(offset_widths), (ContextRule(),) * 3),
    )


def _linear(layer: nn.Module) -> Linear:
    assert isinstance(layer, nn.Linear)
    return Linear.quantised(layer.weight.cpu().numpy(), layer.bias.cpu().numpy(), bits=WEIGHT_BITS)
