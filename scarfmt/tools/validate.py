"""Whether a file keeps every rule of SPEC.md: not the first fault a reader would meet, but all that can be found.

A fault ends only what depends on it: a damaged header ends everything, a damaged tile only that tile. Tiles are
decoded up to their integers by the definition in NumPy, which says what is wrong; attributes are not computed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from scarfmt.blocks.metadata import check_registered, read_metadata
from scarfmt.blocks.registry import BLOCKS
from scarfmt.blocks.spec import Reading
from scarfmt.blocks.streaming import check_place, check_streaming
from scarfmt.coding.models import NOTHING_OPENED, SceneModels
from scarfmt.coding.reader import SceneReader, table_of
from scarfmt.coding.tile import TileContent
from scarfmt.coding.work import NumberBudget
from scarfmt.coding.writer import Report, silent
from scarfmt.container.directory import block_name
from scarfmt.container.file import Container, Entry, read_header
from scarfmt.container.schema import (
    FILE_HEADER_SIZE,
    LAYER_SUMMARY,
    LAYER_SUMMARY_SIZE,
    STREAM_COUNT,
    BlockKind,
    Profile,
    Stream,
    field_table,
)
from scarfmt.container.source import ByteSource, BytesSource
from scarfmt.container.substreams import check_substream, unpack_table
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.errors import InvalidInput, Malformed, ScarError, plural
from scarfmt.limits import DEFAULT_LIMITS, Limits
from scarfmt.scene.model import SceneModel

ERROR, WARNING = "error", "warning"

_SUMMARY_OFFSETS = {row.name: row.offset for row in field_table(LAYER_SUMMARY)}


@dataclass(frozen=True)
class Finding:
    """One fault.

    Attributes:
        refusal: refusal id of SPEC §12, or, of a warning, what is odd.
        message: what is wrong.
        offset: byte offset in the file, if known.
        field: name of the field or block, if known.
        severity: ``"error"`` for a broken rule, ``"warning"`` for wasted bytes.
    """

    refusal: str
    message: str
    offset: int | None = None
    field: str | None = None
    severity: str = ERROR


@dataclass
class Validation:
    """The checks that were made, and the faults that were found.

    Attributes:
        findings: in the order they were found.
        layers_declared: layers the header declares; 0 when the header is unreadable.
        layers_available: layers whose blocks have all arrived.
        layers_checked: how many of these, from the first, were looked at.
        layers_readable: how many of these, from the first, decode in every tile: what of the file can be saved.
        blocks_checked: blocks read and verified.
        tiles_decoded: tiles decoded to integers without a fault.
    """

    findings: list[Finding] = field(default_factory=list)
    layers_declared: int = 0
    layers_available: int = 0
    layers_checked: int = 0
    layers_readable: int = 0
    blocks_checked: int = 0
    tiles_decoded: int = 0

    @property
    def valid(self) -> bool:
        """Whether no rule is broken; warnings do not count."""
        return all(finding.severity != ERROR for finding in self.findings)

    def as_json(self) -> dict[str, Any]:
        """A JSON-able description."""
        return {"valid": self.valid, **asdict(self)}


def validate(
    source: ByteSource, *, layers: int | None = None, limits: Limits = DEFAULT_LIMITS, report: Report = silent
) -> Validation:
    """Check a file against every rule.

    Args:
        source: the file, whole or cut short (a cut is a finding; what arrived is checked).
        layers: check only the blocks of the first `layers` layers; None for all that arrived.
        limits: what counts as too large: a file beyond them is not decoded, and has a finding that says so. For a file
            that is trusted `scarfmt.limits.FORMAT_LIMITS` stands for no limits but the format's own.

    Raises:
        InvalidInput: ``input-layers`` when the file does not declare so many layers.
    """
    result = Validation()
    opened = _open(source, limits, result)
    if opened is None:
        return result
    if layers is not None and not 1 <= layers <= opened.header.layer_count:
        raise InvalidInput("input-layers", f"the file has {plural(opened.header.layer_count, 'layer')}, not {layers}")
    result.layers_checked = min(result.layers_available, layers or result.layers_available)
    _Check(opened, result, report).run()
    return result


def open_damaged(source: ByteSource, tell: Callable[[ScarError], object], limits: Limits) -> Container | None:
    """The file, as far as its header can be used; `tell` is called with a fault of that."""
    try:
        read_header(source, limits=limits)
    except ScarError as error:
        tell(error)
        if error.refusal == "trailing-bytes" and error.offset is not None:
            source = BytesSource(source.read(0, error.offset))
        elif error.refusal != "truncated-file":
            return None
    return Container(source, limits=limits, allow_truncated=True)


def _open(source: ByteSource, limits: Limits, result: Validation) -> SceneReader | None:
    """A reader of the file, or None where header or tables are beyond use; faults go to `result`."""
    container = open_damaged(source, lambda error: result.findings.append(_finding(error)), limits)
    if container is None:
        return None
    result.layers_declared, result.layers_available = container.header.layer_count, container.available_layers
    try:
        reader = SceneReader(container.source, limits=limits, allow_truncated=True)
        reader.container.load()
        return reader
    except ScarError as error:
        result.findings.append(_finding(error))
        return None


def _finding(error: ScarError) -> Finding:
    return Finding(error.refusal, error.message, error.offset, error.field)


def _place(finding: Finding) -> tuple[str, int | None, str | None]:
    return finding.refusal, finding.offset, finding.field


def _summary_offset(layer: int, name: str) -> int:
    return FILE_HEADER_SIZE + (layer - 1) * LAYER_SUMMARY_SIZE + _SUMMARY_OFFSETS[name]


class _UsedTables(dict[TableKey, SymbolTable]):
    """Tables of a layer that remember which of them were asked for, also one by one."""

    def __init__(self, tables: dict[TableKey, SymbolTable], used: set[TableKey]) -> None:
        super().__init__(tables)
        self._used = used

    def get(self, key: TableKey, default: Any = None) -> Any:
        self._used.add(key)
        return super().get(key, default)


class _Check:
    """One validation, from an opened file on."""

    def __init__(self, reader: SceneReader, result: Validation, report: Report) -> None:
        self._reader = reader
        self._container = reader.container
        self._result = result
        self._report = report
        self._last = result.layers_checked
        self._budget = NumberBudget(reader.header.file_length, reader.container.limits)
        self._places = {_place(finding) for finding in result.findings}
        self._broken: list[Entry] = []
        self._miscounted: list[ScarError] = []
        self._opening = NOTHING_OPENED
        self._models: dict[int, SceneModels] = {}
        self._begun = 0
        self._tables: list[dict[TableKey, SymbolTable]] = [{} for _ in range(self._last)]
        self._used: list[set[TableKey]] = [set() for _ in range(self._last)]
        self._streams = np.zeros((self._last + 1, STREAM_COUNT), np.int64)
        self._gaussians = np.zeros(self._last + 1, np.int64)

    def run(self) -> None:
        """All checks; later ones leave out what earlier ones found broken. Rules marked (V) come last (SPEC §12.2)."""
        self._check_blocks()
        usable = self._usable_layers()
        self._check_broken_tables(usable)
        complete = self._check_tiles(usable)
        for error in self._miscounted:
            self._add(error)
        self._check_stream_bytes()
        if complete and usable == self._last:
            self._check_gaussians()
            self._check_tables_used()

    def _add(self, error: ScarError) -> None:
        finding = _finding(error)
        if _place(finding) not in self._places:
            self._places.add(_place(finding))
            self._result.findings.append(finding)

    def _attempt(self, entry: Entry, act: Callable[[], object]) -> bool:
        try:
            act()
        except ScarError as error:
            offset = entry.offset if error.offset is None else error.offset
            self._add(type(error)(error.refusal, error.message, offset=offset, field=error.field or block_name(entry)))
            self._broken.append(entry)
            return False
        return True

    def _check_blocks(self) -> None:
        entries = [entry for entry in self._container.entries if entry.layer <= self._last]
        for number, entry in enumerate(entries):
            self._report("blocks", number / len(entries))
            if self._attempt(entry, partial(self._check_block, entry)):
                self._result.blocks_checked += 1

    def _check_block(self, entry: Entry) -> None:
        payload = self._container.read_block(entry)
        if entry.kind == BlockKind.TILE:
            self._check_tile_block(entry, payload)
            return
        self._streams[entry.layer, Stream.MODELS] += len(payload)
        if entry.kind == BlockKind.METADATA:
            check_registered(read_metadata(self._container) or {}, entry.offset)
        if entry.kind == BlockKind.STREAMING:
            self._check_streaming(entry, payload)
            return
        self._count_elements(entry, self._element_count(entry, payload))

    def _check_streaming(self, entry: Entry, payload: bytes) -> None:
        """Check the STREAMING block, which decodes nothing: its faults come after all others and exclude nothing."""
        try:
            check_place(entry)
            found = check_streaming(self._container, entry, payload)
            self._count_elements(entry, found.tiles)
        except ScarError as error:
            self._miscounted.append(error)

    def _count_elements(self, entry: Entry, count: int | None) -> None:
        if count is not None and count != entry.count:
            message = f"the block holds {count} elements, the directory says {entry.count}"
            field = f"{block_name(entry)} count"
            self._miscounted.append(Malformed("entry-count", message, offset=entry.offset, field=field))

    def _element_count(self, entry: Entry, payload: bytes) -> int | None:
        """Elements of a model block, parsed; None for kinds that are not known, or that need what is broken."""
        spec = BLOCKS.get(entry.kind)
        if spec is None or (entry.kind == BlockKind.LAYER and entry.layer > 1 and not self._opening[0]):
            return None
        value = spec.parse(payload, Reading(entry.layer, self._opening, self._budget.spend))
        if entry.kind == BlockKind.LAYER:
            self._opening = value[1]
        elif entry.kind == BlockKind.TABLES:
            self._tables[entry.layer - 1] = value
        return spec.count(value)

    def _check_tile_block(self, entry: Entry, payload: bytes) -> None:
        table = unpack_table(payload, len(payload))
        rest = len(payload)
        for kind, part in table.items():
            check_substream(kind, part, payload[part.start : part.start + part.length])
            self._streams[entry.layer, kind] += part.length
            rest -= part.length
        self._streams[entry.layer, Stream.FRAMING] += rest

    def _check_broken_tables(self, usable: int) -> None:
        """Sub-streams that code nothing, in the blocks whose damage keeps them from being decoded."""
        if usable:
            model = self._models_of(usable).model
            for entry in [entry for entry in self._broken if entry.kind == BlockKind.TILE]:
                self._attempt(entry, partial(self._check_table, entry, model))

    def _check_table(self, entry: Entry, model: SceneModel) -> None:
        table_of(self._container.read_block(entry), entry, model)

    def _check_stream_bytes(self) -> None:
        """Layer summaries against the sub-streams; a layer with a broken block cannot be summed."""
        broken = {entry.layer for entry in self._broken}
        for layer in range(1, self._last + 1):
            declared = self._reader.header.layers[layer - 1].stream_bytes
            for kind in Stream if layer not in broken else ():
                if declared[kind] != self._streams[layer, kind]:
                    self._add(
                        Malformed(
                            "layer-stream-bytes",
                            f"its blocks spend {self._streams[layer, kind]} bytes on {kind.name}, the summary says "
                            f"{declared[kind]}",
                            offset=_summary_offset(layer, "stream_bytes") + 8 * kind,
                            field=f"layers[{layer - 1}].stream_bytes[{int(kind)}]",
                        )
                    )

    def _usable_layers(self) -> int:
        """Layers, from the first, whose models can be used.

        What a layer adds never mends what layers before it broke. So few attempts suffice, and one for a sound file:
        each reads all models anew. The first is what a decoder of all layers does, and finds what that one finds.
        """
        low, high, step = 0, self._last, self._last
        found: list[ScarError] = []
        while low < high:
            layer = low + step
            self._report("models", layer / self._last)
            try:
                self._models_of(layer)
                low = layer
            except ScarError as error:
                high = layer - 1
                found.append(error)
            step = (high - low + 1) // 2
        for fault in (*found[:1], *found[-1:]):
            self._add(fault)
        return low

    def _models_of(self, layer: int) -> SceneModels:
        """The models after a layer, which note what tables are used."""
        if layer not in self._models:
            models = self._reader.models(layer)
            recorded = tuple(_UsedTables(tables, used) for tables, used in zip(models.tables, self._used, strict=False))
            self._models[layer] = replace(models, tables=recorded)
        return self._models[layer]

    def _check_tiles(self, usable: int) -> bool:
        """Decode every tile as far as its blocks and the models are sound; True if that is all of them."""
        complete, readable = True, usable
        tiles = self._reader.header.tile_count
        lowest = {entry.tile: entry.layer for entry in reversed(self._broken)}
        filled = self._reader.container.have_blocks(self._last, np.arange(tiles)).tolist()
        for tile in range(tiles):
            self._report("tiles", tile / tiles)
            top = min(usable, lowest.get(tile, self._last + 1) - 1)
            complete &= top == self._last
            if top and not filled[tile]:
                self._result.tiles_decoded += 1
            elif top and not self._decode(self._models_of(top), tile):
                complete, top = False, self._begun - 1
            readable = min(readable, top)
        self._result.layers_readable = readable
        return complete

    def _decode(self, models: SceneModels, tile: int) -> bool:
        """Decode a tile; where that fails, `_begun` is the layer that is at fault."""
        self._begun = 1
        try:
            for _, content in self._reader.tiles(models, [tile], observe=self._begin):
                if len(content):
                    self._count(content)
        except ScarError as error:
            place = f"tile {tile}" if error.field is None else f"tile {tile} {error.field}"
            self._add(type(error)(error.refusal, error.message, offset=error.offset, field=place))
            return False
        self._result.tiles_decoded += 1
        return True

    def _begin(self, _tile: int, layer: int) -> None:
        self._begun = layer

    def _count(self, content: TileContent) -> None:
        for layer in range(1, self._last + 1):
            shown = (content.slot_layers > 0) & (content.slot_layers <= layer)
            self._gaussians[layer] += int(shown.sum())

    def _check_gaussians(self) -> None:
        if self._reader.header.fields.profile == Profile.EXPLICIT:
            return
        for layer in range(1, self._last + 1):
            declared = self._reader.header.layers[layer - 1].gaussian_count
            if declared != self._gaussians[layer]:
                message = f"the masks turn on {self._gaussians[layer]} Gaussians, the summary says {declared}"
                offset, name = _summary_offset(layer, "gaussian_count"), f"layers[{layer - 1}].gaussian_count"
                self._add(Malformed("layer-counts", message, offset=offset, field=name))

    def _check_tables_used(self) -> None:
        """Warn of tables nothing was coded with: legal, but bytes for nothing."""
        if self._last < self._reader.header.layer_count:
            return
        for layer, sent in enumerate(self._tables, start=1):
            idle = [key for key in sent if not self._is_used(key, layer)]
            if idle:
                entry = self._container.find(BlockKind.TABLES, layer)
                message = f"{len(idle)} of {len(sent)} tables are never used, the first is {idle[0]}"
                offset = entry.offset if entry else None
                self._result.findings.append(Finding("unused-table", message, offset, f"layer {layer} TABLES", WARNING))

    def _is_used(self, key: TableKey, layer: int) -> bool:
        for later in range(layer, self._last + 1):
            if later > layer and key in self._tables[later - 1]:
                return False
            if key in self._used[later - 1]:
                return True
        return False
