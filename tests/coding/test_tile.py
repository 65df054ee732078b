"""One tile, layer by layer: what a decoder holds after each, and which streams it needs for that."""

from __future__ import annotations

import numpy as np

from fuzz.testing.scenes import random_scene
from scarfmt.blocks.tables import fit_table
from scarfmt.coding.tile import TileContent, find_needed, get_layer, put_layer
from scarfmt.container.directory import TileFrame
from scarfmt.container.schema import Profile, Stream
from scarfmt.entropy.emitters import SymbolCounter, SymbolWriter
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_reader import SymbolReader
from scarfmt.entropy.symbol_tables import SymbolTable
from scarfmt.scene.model import Channel, LayerRow, SceneModel
from tests.samples.codec_samples import refuses
from tests.samples.contents import ATTRIBUTES, arrays_of

Tables = dict[TableKey, SymbolTable]


def four_channels() -> SceneModel:
    streams = Stream.SCALE, Stream.ROTATION, Stream.OPACITY, Stream.COLOUR
    channels = tuple(Channel(stream, (0.5,)) for stream in streams)
    return SceneModel(Profile.EXPLICIT, 1, channels, (LayerRow((0,), ((1, 1, 1, 1),)),))


def test_without_predictors_nothing_but_what_is_wanted_is_needed() -> None:
    wanted = {Stream.OPACITY, Stream.ROTATION}
    assert find_needed(four_channels(), wanted) == wanted


def test_the_head_of_a_tile_is_the_tile_itself() -> None:
    """A layer is read into a view of the arrays that hold all layers."""
    whole = random_scene(1, Profile.ANCHOR, anchors=30, tiles=1).contents[0]
    head = whole.head(12)
    assert len(head) == 12
    for part, array in zip(arrays_of(head), arrays_of(whole), strict=True):
        assert part.shape[1:] == array.shape[1:]
        assert part.size == 0 or np.shares_memory(part, array)
    head.classes[:] = 7
    assert (whole.classes == 7).sum() == 12


def test_a_position_residual_beyond_its_cell_is_refused_in_the_layer_that_sends_it() -> None:
    """Even where a later layer brings it back: a cut file must not break a rule that the whole one keeps."""
    channels = (Channel(Stream.POSITION_RESIDUAL, (0.1875,) * 3),)
    rows = (LayerRow((0,), ((1,),)), LayerRow((0,), ((2,),)))
    model = SceneModel(Profile.EXPLICIT, 1, channels, rows)
    content = TileContent.empty(model, 1)
    content.values[0][:] = 16  # 16 * 0.0625 = 1 after both steps, but 5 * 0.1875 = 0.9375 after the first
    assert decoded(model, content).values[0].tolist() == [[16, 16, 16]]
    content.values[0][0] = [0, 17, 0]  # 17 * 0.0625 is out; after the first step it is 6 * 0.1875 = 1.125
    refuses("value-range", lambda: decoded(model, content, layers=1))


def decoded(model: SceneModel, content: TileContent, layers: int = 2) -> TileContent:
    """The tile of one anchor after coding and decoding, without what a writer checks."""
    out = TileContent.empty(model, 1)
    for layer in range(1, layers + 1):
        counter = SymbolCounter()
        put_layer(model, layer, TileFrame(4), content, lambda _, counter=counter: counter)
        tables = {key: fit_table(*histogram) for key, histogram in counter.histograms().items()}
        writers: dict[Stream, SymbolWriter] = {}
        new = put_layer(
            model, layer, TileFrame(4), content, lambda s, w=writers, t=tables: w.setdefault(s, SymbolWriter(t))
        )
        streams = {stream: writer.finish() for stream, writer in writers.items()}

        def opened(stream: Stream, data: dict[Stream, bytes] = streams, known: Tables = tables) -> SymbolReader:
            return SymbolReader(data.get(stream, b""), known)

        get_layer(model, layer, TileFrame(4), out, new, opened, ATTRIBUTES, (0, 0))
    return out
