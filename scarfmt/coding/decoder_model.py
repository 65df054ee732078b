"""The time that a decoder takes for the work of a file. Encoder and reports use this one model.

Nanoseconds of one thread with the compiled engine, arrays in memory. ``python -m benchmarks.decoder_costs`` measures
and prints them; they are constants here so that the same scene and options give the same file on every machine.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class DecoderModel:
    """Nanoseconds, and where they come from.

    Attributes:
        date, machine: when and on what they were measured.
        symbol: one symbol from a table of two or more.
        group: opening one table for the symbols of a pass, or of a step without passes.
        tile_layer: beginning one layer of one tile.
        predicted: finding what is decided around an anchor, for each component of a step with predictors.
        predictor_multiply_add: one of a predictor.
        index_row: the inputs of the index network for an anchor, its hash grid among them.
        index_multiply_add: one of the index network.
    """

    date: str
    machine: str
    symbol: float
    group: float
    tile_layer: float
    predicted: float
    predictor_multiply_add: float
    index_row: float
    index_multiply_add: float

    def predictors_ns(self, multiply_adds: int, anchors: int) -> float:
        """Time of predictors. `anchors` are those for which the context of a step is computed, counted once per
        component."""
        return self.predictor_multiply_add * multiply_adds + self.predicted * anchors

    def index_network_ns(self, multiply_adds: int, anchors: int) -> float:
        """Time of an index network. `anchors` are those whose inputs are computed, counted as often as that happens."""
        return self.index_multiply_add * multiply_adds + self.index_row * anchors


DECODER = DecoderModel(
    date="2026-11-22",
    machine="one thread of 2 cores of AMD EPYC (AVX2, no AVX-512), shared with others",
    symbol=12.0,
    group=100.0,
    tile_layer=100_000.0,
    predicted=72.0,
    predictor_multiply_add=0.02,
    index_row=2100.0,
    index_multiply_add=0.035,
)
"""The decoder that the encoder decides for (decisions 0030, 0037)."""

MECHANISMS = "mechanisms"
"""Member of METADATA in which an encoder states what its networks save, and what decoding them takes.

An object with ``index_network`` and ``predictors`` by channel, each present only if kept, with the integers ``saved``
(bytes, its own blocks taken off), ``multiply_adds`` and ``anchors``, as for :class:`DecoderModel`.
"""
