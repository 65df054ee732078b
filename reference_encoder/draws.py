"""Random draws of the encoder that depend on nothing but their seed: no library's version, no thread, no processor.

The words are those of the Mersenne Twister MT19937 (Matsumoto and Nishimura 1998), seeded with a 32-bit integer. What
is made of them here is what `torch.randperm` and `torch.multinomial` make of theirs, so that files written before
these draws had code of their own are written again to the byte; a test compares the two where torch is there.
"""

from __future__ import annotations

import numpy as np

from reference_encoder.jit import compiled
from scarfmt.arrays import F32, I64, U32

_MANTISSA = np.uint64((1 << 53) - 1)


class Draws:
    """A stream of random draws.

    Args:
        seed: at least 0; its lowest 32 bits count.
    """

    def __init__(self, seed: int) -> None:
        self._twister = np.random.RandomState(seed & 0xFFFFFFFF)

    def permutation(self, count: int) -> I64:
        """(count,) int64: the numbers below `count` in random order (Fisher and Yates)."""
        return _shuffled(self._words(max(count - 1, 0)), count)

    def weighted(self, weights: F32, count: int) -> I64:
        """(count,) int64 places in (n,) float32 `weights`, all > 0, drawn without replacement in proportion to them.

        The places with the largest of weight / e, e exponentially distributed (Efraimidis and Spirakis 2006).
        """
        high, low = self._words(2 * len(weights)).astype(np.uint64).reshape(-1, 2).T
        uniform = (((high << np.uint64(32)) | low) & _MANTISSA) / 2.0**53
        waits = (-np.log1p(-uniform)).astype(np.float32)
        return np.argsort(-(weights / waits), kind="stable")[:count]

    def _words(self, count: int) -> U32:
        return self._twister.randint(0, 1 << 32, size=count, dtype=np.uint32)


@compiled
def _shuffled(words: U32, count: int) -> I64:
    """The numbers below `count`, each swapped with one that is not before it."""
    out = np.arange(count)
    for place in range(count - 1):
        other = place + words[place] % (count - place)
        out[place], out[other] = out[other], out[place]
    return out
