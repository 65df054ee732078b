"""Every kind of block that belongs to no tile, in the order of a file's directory (SPEC §16.5).

A kind that is not here is unknown to readers, writers, validators and `scarfmt dump` alike.
"""

from __future__ import annotations

from collections.abc import Mapping

from scarfmt.blocks import codebooks, hash_grid, index_network, layer, metadata_spec, mlp, predictors, streaming, tables
from scarfmt.blocks.spec import BlockSpec
from scarfmt.container.registries import BlockKind

BLOCKS: Mapping[int, BlockSpec] = {
    spec.kind: spec
    for spec in (
        layer.SPEC,
        tables.SPEC,
        codebooks.SPEC,
        mlp.DECODER_SPEC,
        mlp.SCENE_SPEC,
        hash_grid.SPEC,
        index_network.SPEC,
        predictors.SPEC,
        metadata_spec.THUMBNAIL_SPEC,
        metadata_spec.SPEC,
        streaming.SPEC,
    )
}

MODEL_BLOCKS = tuple(spec for spec in BLOCKS.values() if spec.kind <= BlockKind.PREDICTORS)
"""The kinds of blocks that a decoder needs."""
