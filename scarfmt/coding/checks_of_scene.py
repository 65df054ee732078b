"""Rules that a quantised scene must keep for its file to be readable. They expose faults of an encoder when it writes.

Rules of blocks that are small are not repeated here: the writer reads its own model blocks back.
"""

from __future__ import annotations

import numpy as np

from scarfmt.arrays import I64
from scarfmt.codecs.channels import REACH, VALUE_LIMIT, cell_widths, coarsen
from scarfmt.coding.tile import TileContent
from scarfmt.container.schema import Profile, Stream
from scarfmt.errors import InvalidInput
from scarfmt.scene.model import Codebooks, SceneModel, first_layers


def check_books(model: SceneModel, books: Codebooks | None) -> None:
    """Check that the codebooks hold what the stages need.

    Raises:
        InvalidInput: ``input-container``.
    """
    starts = first_layers(model)
    sizes = books.sizes if books else (0, 0)
    for number in (0, 1):
        _require(starts[number] is None or sizes[number] > 0, f"codebook {number} is needed and empty", "codebooks")


def check_content(model: SceneModel, books: Codebooks | None, bits: int, content: TileContent) -> None:
    """Check one tile, at the model's last layer.

    Args:
        bits: local bits per axis of the tile.

    Raises:
        InvalidInput: ``input-container``.
    """
    classes = content.classes
    last = model.layers[-1].class_count
    _require(bool(((classes >= 0) & (classes < last)).all()), f"a class is not in 0..{last - 1}", "classes")
    ends = [row.class_count for row in model.layers]
    appears = np.searchsorted(ends, classes, side="right") + 1
    _check_order(content, appears, bits)
    if model.profile == Profile.ANCHOR:
        on = content.slot_layers
        good = (on == 0) | ((on >= appears[:, None]) & (on <= len(ends)))
        _require(bool(good.all()), "a slot turns on before its anchor or after the last layer", "slot_layers")
    _check_indices(model, books, content)
    for index in range(len(model.channels)):
        _check_values(model, index, content)


def _require(holds: bool, fault: str, field: str) -> None:
    if not holds:
        raise InvalidInput("input-container", f"the file would be unreadable: {fault}", field=field)


def _check_order(content: TileContent, appears: I64, bits: int) -> None:
    codes = content.codes
    _require(not len(codes) or int(codes.max()) >> (3 * bits) == 0, f"a code has more than 3 * {bits} bits", "codes")
    rises = (appears[1:] > appears[:-1]) | ((appears[1:] == appears[:-1]) & (codes[1:] >= codes[:-1]))
    _require(bool(rises.all()), "anchors are not ordered by layer, then code (SPEC §6.3)", "codes")


def _check_indices(model: SceneModel, books: Codebooks | None, content: TileContent) -> None:
    stages = model.stages(len(model.layers), content.classes)
    sizes = books.sizes if books else (0, 0)
    for stage in range(1, int(stages.max(initial=0)) + 1):
        chosen = content.indices[stages >= stage, stage - 1]
        good = bool(((chosen >= 0) & (chosen < sizes[stage > 1])).all())
        _require(good, f"an index of stage {stage} has no codeword", "indices")


def _check_values(model: SceneModel, index: int, content: TileContent) -> None:
    channel, values = model.channels[index], content.values[index]
    name = channel.stream.name
    if values.size:
        reach = max(int(values.max()), -int(values.min()))
        _require(reach <= VALUE_LIMIT, f"{name} has a value beyond 32 bits", "values")
    if channel.stream != Stream.POSITION_RESIDUAL:
        return
    last = model.steps(len(model.layers), index, content.classes)
    for layer in range(1, len(model.layers) + 1):
        steps = model.steps(layer, index, content.classes)
        coarse = coarsen(values, (last - steps)[:, None])
        inside = bool((np.abs(coarse * cell_widths(channel.first_width, steps)) <= REACH).all())
        _require(inside, f"a position residual of layer {layer} leaves -1..1 cells", "values")
