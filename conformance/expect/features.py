"""Words that say what a file has in it, and the rules of SPEC.md that decoding such a file exercises."""

from __future__ import annotations

from collections.abc import Iterator

from conformance.decoders.python.decoder import Decoder
from conformance.decoders.python.fields import LATENT, Refused
from conformance.decoders.python.front import Limits, Root, read_header
from conformance.decoders.python.models import parse_tables
from conformance.decoders.python.numbers import Numbers
from conformance.decoders.python.tile import NAMES

_KNOWN_KINDS = (1, 2, 3, 4, 5, 6, 7, 8, 15, 16, 64)
_OF_NETWORKS = (3, 5, 6, 7, 8)
_TABLES, _TILE, _METADATA, _STREAMING, _NO_TILE = 2, 16, 64, 65, 0xFFFFFFFF

RULES = {
    "anchors": ("R-6.2-1", "R-6.2-2", "R-6.3-1", "R-8.2-3", "R-9.1-1", "R-9.2-1"),
    "no-anchors": ("R-13.2-1",),
    "position-residual": ("R-9.1-2",),
    "decoder-network": ("R-9.2-2",),
    "not-received": ("R-9.2-3",),
    "empty-sub-stream": ("R-7.1-6",),
    "unknown-block": ("R-5.6-2",),
    "inherited-table": ("R-8.3-2",),
    "idle-table": ("R-8.3-4",),
    "predictors": ("R-8.4-2", "R-10.2-2", "R-10.3-4", "R-10.3-5"),
    "passes": ("R-10.2-4",),
    "depths": ("R-10.2-3", "R-10.2-5"),
    "entropy-mode-1": ("R-8.4-2", "R-10.1-2", "R-10.2-2", "R-10.5-8", "R-10.5-9", "R-10.5-10"),
    "hash-grid": ("R-10.6-3",),
    "activated": ("R-9.5-1",),
    "activated-explicit": ("R-9.3-1", "R-9.4-1"),
    "activated-colour": ("R-9.4-2",),
    "activated-harmonics": ("R-9.4-3",),
    "activated-anchor": ("R-9.6-1",),
    "truncated": ("R-14-1", "R-14-2"),
}
"""Rules without a refusal id, by the feature with which a file exercises them."""


def features_of(decoder: Decoder, anchors: int) -> set[str]:
    """The features of a file that was decoded to its last layer, with so many anchors in the end."""
    found = set(_shape(decoder, anchors))
    found |= set(_channels(decoder))
    found |= set(_models(decoder))
    found |= set(_entropy(decoder))
    found |= set(_tables(decoder))
    return found | set(_blocks(decoder))


def is_core(data: bytes, limits: Limits) -> bool:
    """Whether a core decoder (SPEC §2) gives for a file what every decoder does: ROOT lists nothing that it lacks."""
    try:
        header, layers = read_header(data, limits)
        root = Root(data, limits)
        root.check(header, layers)
    except Refused:
        return True
    return header["profile"] == 0 and not any(kind in _OF_NETWORKS for models in root.models for kind, *_ in models)


def list_rules(features: set[str]) -> set[str]:
    """The rules that decoding a file of these features exercises."""
    return {rule for feature in features for rule in RULES.get(feature, ())}


def _shape(decoder: Decoder, anchors: int) -> Iterator[str]:
    yield "anchor" if decoder.profile else "explicit"
    yield "several-layers" if len(decoder.rows) > 1 else "one-layer"
    yield "anchors" if anchors else "no-anchors"
    if len(decoder.tiles) > 1:
        yield "several-tiles"
    if decoder.pages > 1:
        yield "several-pages"
    if decoder.classes(decoder.k) > 1:
        yield "several-classes"
    if decoder.degree:
        yield f"sh-degree-{decoder.degree}"


def _channels(decoder: Decoder) -> Iterator[str]:
    names = {channel.stream: NAMES[channel.stream].lower().replace("_", "-") for channel in decoder.channels}
    yield from names.values()
    last = [steps for _, steps in decoder.rows[-1].classes]
    if any(n > 1 for steps in last for n in steps):
        yield "refined"
    missing = any(n == 0 for row in decoder.rows for _, steps in row.classes for n in steps)
    if missing or (not decoder.profile and not {6, 7} <= set(names)):
        yield "not-received"


def _models(decoder: Decoder) -> Iterator[str]:
    stages = max((stages for stages, _ in decoder.rows[-1].classes), default=0)
    if stages:
        yield "stages"
    if stages > 1:
        yield "residual-codebook"
    if decoder.dimension:
        yield "decoder-network"
    for _, kind, _ in decoder.blocks:
        if kind == _METADATA:
            yield "metadata"
        elif kind == _STREAMING:
            yield "streaming"
        elif kind not in _KNOWN_KINDS:
            yield "unknown-block"


def _entropy(decoder: Decoder) -> Iterator[str]:
    coded = [any(name.startswith("INDICES") for name in trace.frequencies) for trace in decoder.traces]
    yield from (f"entropy-mode-{row.mode}" for row, any_index in zip(decoder.rows, coded, strict=True) if any_index)
    if decoder.opening.passes_log2:
        yield "passes"
    if decoder.opening.targets:
        yield "depths"
    predictors = decoder.predictors[-1]
    if predictors:
        yield "predictors"
    if any(stream == LATENT for stream, _, _ in predictors):
        yield "predicted-latents"
    if any(predictor.hidden for predictor in predictors.values()):
        yield "hidden-units"
    if decoder.grid:
        yield "hash-grid"
        yield from ("dense-level" if level.dense else "hashed-level" for level, _ in decoder.grid.levels)
    if decoder.network:
        if decoder.network.attention:
            yield "attention"
        if len(decoder.network.gru) > 1:
            yield "several-recurrent-layers"


def _tables(decoder: Decoder) -> Iterator[str]:
    sent = set()
    for k in range(1, decoder.k + 1):
        block, _ = decoder.blocks.get((k, _TABLES, _NO_TILE), (b"", 0))
        here = parse_tables(Numbers(block)) if block else {}
        sent |= set(here)
        if any(len(table.values) == 1 for table in here.values()):
            yield "one-symbol-table"
        if any(len(table.values) > 1 for table in here.values()):
            yield "several-symbol-table"
        if (decoder.traces[k - 1].used & set(decoder.tables[k - 1])) - set(here):
            yield "inherited-table"
        if set(here) - set().union(*(trace.used for trace in decoder.traces[k - 1 :])):
            yield "idle-table"


def _blocks(decoder: Decoder) -> Iterator[str]:
    for k in range(1, decoder.k + 1):
        if any((k, _TILE, number) not in decoder.blocks for number in range(len(decoder.tiles))):
            yield "no-tile-block"
        if decoder.traces[k - 1].unwritten:
            yield "empty-sub-stream"
