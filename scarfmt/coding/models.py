"""From model blocks to everything of a file that belongs to no tile, in the order of checks of SPEC §12.2."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from scarfmt.blocks.mlp import QuantisedMlp
from scarfmt.blocks.registry import BLOCKS, MODEL_BLOCKS
from scarfmt.blocks.spec import Reading
from scarfmt.coding.checks_of_models import check_index_network, check_networks
from scarfmt.coding.tile import NeuralModels
from scarfmt.container.directory import Entry, block_name
from scarfmt.container.header import HeaderFields
from scarfmt.container.registries import BlockKind, Stream
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.numbers import Spend
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import Malformed, ScarError
from scarfmt.neural.evaluator import Evaluator
from scarfmt.neural.grid import HashGrid
from scarfmt.neural.network import IndexNetwork
from scarfmt.neural.predictors import Predictor, check_predictors
from scarfmt.scene.model import Codebooks, DecodedContext, LayerRow, Opening, SceneModel, first_layers

T = TypeVar("T")

PredictorsByKey = dict[tuple[int, int, int], Predictor]

NOTHING_OPENED: Opening = (), DecodedContext()
"""Before the LAYER block of layer 1."""


def run_at(entry: Entry, act: Callable[[], T]) -> T:
    """Run `act`; an error without an offset gets that of the block it came from."""
    try:
        return act()
    except ScarError as error:
        if error.offset is not None:
            raise
        raise type(error)(error.refusal, error.message, offset=entry.offset, field=error.field) from error


class ModelBlocks:
    """Verified payloads of model blocks, to be parsed as the registry says.

    Args:
        payloads: of each block.
        spend: takes adaptive numbers from what is allowed.
    """

    def __init__(self, payloads: Mapping[Entry, bytes], spend: Spend) -> None:
        self._blocks = {(entry.kind, entry.layer): (entry, payload) for entry, payload in payloads.items()}
        self._spend = spend

    def __len__(self) -> int:
        return len(self._blocks)

    def parse(self, kind: BlockKind, layer: int, opening: Opening = NOTHING_OPENED) -> Any:
        """The parsed content of a block; None if there is no such block and the file is valid without it.

        Raises:
            Malformed: ``missing-block``, or a block that breaks its rules.
        """
        spec = BLOCKS[kind]
        if (kind, layer) not in self._blocks:
            if spec.required:
                raise Malformed(
                    "missing-block", f"layer {layer} needs a {kind.name} block (SPEC §6.5)", field=kind.name
                )
            return None
        entry, payload = self._blocks[kind, layer]
        return run_at(entry, lambda: spec.parse(payload, Reading(layer, opening, self._spend)))

    def needed(self, kind: BlockKind, model: SceneModel) -> Iterator[tuple[int, Any]]:
        """(layer, what the block holds) of each layer that first needs a block of a kind, read one after the other."""
        layers = BLOCKS[kind].layers
        found = () if layers is None else layers(model)
        for layer in sorted(layer for layer in found if layer is not None):
            yield layer, self.parse(kind, layer)

    def refuse_unexpected(self, model: SceneModel) -> None:
        """Refuse a block that no layer needs: one decoder would read it and another skip it (SPEC §7.8-7.9).

        Raises:
            Malformed: ``unexpected-block``.
        """
        expected = {spec.kind: spec.layers(model) for spec in MODEL_BLOCKS if spec.layers is not None}
        for layer in range(1, len(model.layers) + 1):
            for kind, layers in expected.items():
                if layer not in layers and (kind, layer) in self._blocks:
                    entry = self._blocks[kind, layer][0]
                    message = "nothing first needs this block in its layer (SPEC §7.8-7.9)"
                    raise Malformed("unexpected-block", message, offset=entry.offset, field=block_name(entry))


@dataclass(frozen=True)
class SceneModels:
    """Everything of a file's first `layers` layers that belongs to no tile.

    Attributes:
        model: channels, classes and layer rows.
        tables: static tables in force in each layer.
        codebooks: with empty books where none is sent; None when no stage is used.
        decoder: latent to SH or feature, or None.
        scene_mlps: networks of the anchor profile.
        predictors: context predictors in force in each layer, by key.
        network: the index network, None where no layer is of entropy mode 1.
        grid: the hash grid it reads, or None.
    """

    model: SceneModel
    tables: tuple[dict[TableKey, SymbolTable], ...]
    codebooks: Codebooks | None
    decoder: QuantisedMlp | None
    scene_mlps: tuple[QuantisedMlp, ...]
    predictors: tuple[dict[tuple[int, int, int], Predictor], ...] = ()
    network: IndexNetwork | None = None
    grid: HashGrid | None = None

    def neural(self, *, indices: bool = True) -> tuple[NeuralModels, ...]:
        """The models that code symbols beside static tables, for each layer.

        Without `indices`, the index network is not prepared: none can be decoded.
        """
        coder = None
        if indices and self.network is not None and self.codebooks is not None:
            coder = Evaluator(self.network, self.codebooks, self.grid)
        return tuple(NeuralModels(predictors, coder) for predictors in self.predictors)


def load_models(fields: HeaderFields, layers: int, blocks: ModelBlocks) -> SceneModels:
    """The models of a file's first `layers` layers.

    Args:
        layers: at least 1.
        blocks: the model blocks of these layers.

    Raises:
        Malformed: a block is missing or breaks its rules.
        LimitExceeded: ``limit-expansion`` beside the limits of blocks.
    """
    rows: list[LayerRow] = []
    opening = NOTHING_OPENED
    tables: list[dict[TableKey, SymbolTable]] = []
    for layer in range(1, layers + 1):
        row, opening = blocks.parse(BlockKind.LAYER, layer, opening)
        rows.append(row)
        new = blocks.parse(BlockKind.TABLES, layer) or {}
        tables.append({**(tables[-1] if tables else {}), **new})
    channels, context = opening
    model = SceneModel(fields.profile, fields.slots, channels, tuple(rows), context)
    model.check()
    blocks.refuse_unexpected(model)
    books, decoder = _latent_models(model, blocks)
    mlps = next((found for _, found in blocks.needed(BlockKind.SCENE_MLP, model)), None) or ()
    check_networks(fields, model, decoder, mlps)
    network, grid = _index_models(model, blocks, books)
    return SceneModels(model, tuple(tables), books, decoder, mlps, _predictors(model, blocks), network, grid)


def _latent_models(model: SceneModel, blocks: ModelBlocks) -> tuple[Codebooks | None, QuantisedMlp | None]:
    """Codebooks and latent decoder, each from the layer that first needs it."""
    networks = next((found for _, found in blocks.needed(BlockKind.DECODER_MLP, model)), None)
    if networks is None:
        return None, None
    dimension = networks[0].inputs if len(networks) == 1 else 0
    for channel in model.channels:
        if channel.stream == Stream.LATENT and channel.components != dimension:
            raise Malformed("bad-mlp", "the decoder does not take the latent channel (SPEC §7.9)", field="decoder")
    starts = first_layers(model)
    if starts[0] is None:
        return None, networks[0]
    books: dict[int, NDArray[np.int64]] = {}
    for layer, here in blocks.needed(BlockKind.CODEBOOKS, model):
        # Exactly the books first needed here: else a cut file would be refused where the whole one is read.
        if set(here) != {number for number in (0, 1) if starts[number] == layer}:
            raise Malformed("bad-codebook", "codebooks do not match the stages used (SPEC §7.8)", field="codebooks")
        books.update(here)
    if {words.shape[1] for words in books.values()} != {dimension}:
        raise Malformed("bad-mlp", "the decoder does not take the codewords (SPEC §7.9)", field="decoder")
    residual = books.get(1, np.zeros((0, dimension), np.int64))
    return Codebooks(books[0], residual), networks[0]


def _index_models(
    model: SceneModel, blocks: ModelBlocks, books: Codebooks | None
) -> tuple[IndexNetwork | None, HashGrid | None]:
    """Index network and hash grid, from the first layer of entropy mode 1."""
    network: IndexNetwork | None = next((found for _, found in blocks.needed(BlockKind.ENTROPY_NETWORK, model)), None)
    if network is None or books is None:
        return None, None
    grid: HashGrid | None = next((found for _, found in blocks.needed(BlockKind.HASH_GRID, model)), None)
    check_index_network(model, books, network, grid)
    return network, grid


def _predictors(model: SceneModel, blocks: ModelBlocks) -> tuple[PredictorsByKey, ...]:
    """Predictors in force in each layer."""
    out: list[PredictorsByKey] = []
    for layer in range(1, len(model.layers) + 1):
        new = blocks.parse(BlockKind.PREDICTORS, layer) or ()
        check_predictors(model, layer, new)
        out.append({**(out[-1] if out else {}), **{predictor.key: predictor for predictor in new}})
    return tuple(out)
