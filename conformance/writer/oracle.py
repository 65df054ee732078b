"""An index network that is held in memory, evaluated by the second decoder: its block is written and parsed again.

Tests and benchmarks compare every other evaluation of SPEC §10.5 with this one: Python integers, one anchor at a time.
"""

from __future__ import annotations

from itertools import pairwise

from conformance.decoders.python.arithmetic import Matrix, Vector, clamp
from conformance.decoders.python.index_network import Coder, frequencies, parse_network
from conformance.decoders.python.numbers import Numbers
from scarfmt.blocks.index_network import pack_network
from scarfmt.neural.network import IndexNetwork


class Oracle:
    """The network of one scene.

    Args:
        network: valid, as :meth:`IndexNetwork.check` finds.
        coarse, residual: the codebooks, a list of int lists each.

    Attributes:
        network: as the second decoder has it.
    """

    def __init__(self, network: IndexNetwork, coarse: Matrix, residual: Matrix) -> None:
        self.network = parse_network(Numbers(pack_network(network)))
        books = zip(self.network.heads, (coarse, residual), strict=False)
        self._coders = [Coder(self.network, head, book) for head, book in books]

    def context(self, x: Vector, codes: Vector) -> Vector:
        """y of the stage that follows the indices `codes`, of input columns `x`."""
        net = self.network
        words = [self._coders[min(number, 1)].words[code] for number, code in enumerate(codes)]
        return net.mix(net.embedding([clamp(v, -net.amax, net.amax) for v in x]), words)

    def top(self, book: int, y: Vector) -> Vector:
        """Frequencies of the codewords."""
        return frequencies_of(self._coders[book].logits(y))


def frequencies_of(logits: Vector) -> Vector:
    """Frequencies, each >= 1 and 2^24 together, of logits in units of 1/32 bit (SPEC §8.1, R-10.5-10)."""
    return [past - low for low, past in pairwise(frequencies(logits))]
