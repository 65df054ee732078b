"""The properties of a kind of model block, for readers, writers, validators and `scarfmt dump` (SPEC §5.4, §7).

Each kind's own module has its :class:`BlockSpec`; :mod:`scarfmt.blocks.registry` lists them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

from scarfmt.blocks.declare import Record
from scarfmt.container.registries import BlockKind
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.numbers import Spend
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.scene.model import Opening, SceneModel


@dataclass(frozen=True)
class Reading:
    """The values that reading a block depends on, beside its bytes.

    Attributes:
        layer: of the block, 1-based.
        opening: what the LAYER block of layer 1 says.
        spend: takes adaptive numbers from what is allowed.
    """

    layer: int
    opening: Opening
    spend: Spend


@dataclass(frozen=True)
class Writing:
    """A layer that is to be written.

    Attributes:
        parts: the :class:`scarfmt.coding.writer.QuantisedScene`, which is made of what blocks hold.
        layer: 1-based.
        tables: static tables that this layer sends.
    """

    parts: Any
    layer: int
    tables: Mapping[TableKey, SymbolTable]


def no_parameters(payload: bytes, reading: Reading) -> dict[str, Any]:
    """The parameters of a declaration that depends on nothing."""
    return {}


@dataclass(frozen=True)
class BlockSpec:
    """A kind of block that belongs to no tile.

    Attributes:
        kind: its number.
        section: of SPEC.md that describes it.
        declaration: layout of its payload.
        parse: payload -> value; refuses what breaks the rules of its section.
        pack: the inverse.
        taken: the value to write in a layer where the block may stand, None for no block.
        count: value -> what the directory's `count` must be.
        elements: what that counts, as R-5.4-19 says it.
        layers: model -> layers in which something first needs the block, None for what nothing needs; it may stand
            nowhere else. None for kinds that may stand in any layer.
        required: whether it must stand in all of these.
        parameters: what the declaration is read with.
    """

    kind: BlockKind
    section: str
    declaration: Record
    parse: Callable[[bytes, Reading], Any]
    pack: Callable[[Any], bytes]
    taken: Callable[[Writing], Any]
    count: Callable[[Any], int]
    elements: str
    layers: Callable[[SceneModel], Collection[int | None]] | None = None
    required: bool = False
    parameters: Callable[[bytes, Reading], dict[str, Any]] = no_parameters
