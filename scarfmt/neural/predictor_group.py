"""Predictors of one step of one channel evaluated together: one product for all components (SPEC §10.3)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from scarfmt.arrays import F32, I64
from scarfmt.neural.predictors import AMAX, Predictor


class PredictorGroup:
    """Predictors that read the same anchors, each with relative inputs of its own component.

    Zeros stand where a predictor does not read another component's relative inputs: the sums are the same integers.

    Args:
        predictors: by component.
        components: of the channel.
        depths: of the decoded context.
    """

    def __init__(self, predictors: Mapping[int, Predictor], components: int, depths: int) -> None:
        self.components = sorted(predictors)
        chosen = [predictors[component] for component in self.components]
        shared = chosen[0].inputs - depths
        width = shared + components * depths
        units = [predictor.units for predictor in chosen]
        ends = np.cumsum([0, *units])
        self._hidden = np.zeros((int(ends[-1]), width), np.float32)
        self._hidden_biases = np.zeros((int(ends[-1]), 1), np.float32)
        self._direct = np.zeros((2 * len(chosen), width), np.float32)
        self._output = np.zeros((2 * len(chosen), int(ends[-1])), np.float32)
        self._biases = np.zeros((2 * len(chosen), 1), np.float32)
        for number, (component, predictor) in enumerate(zip(self.components, chosen, strict=True)):
            own = shared + component * depths
            columns = np.concatenate([np.arange(shared), np.arange(own, own + depths)])
            rows, hidden = slice(2 * number, 2 * number + 2), slice(int(ends[number]), int(ends[number + 1]))
            weights, biases = predictor.output.folded
            self._direct[rows, columns] = weights[: predictor.inputs].T
            self._output[rows, hidden] = weights[predictor.inputs :].T
            self._biases[rows, 0] = biases
            if predictor.hidden is not None:
                weights, biases = predictor.hidden.folded
                self._hidden[hidden, columns] = weights.T
                self._hidden_biases[hidden, 0] = biases
        buckets = np.array([predictor.buckets for predictor in chosen], np.float32)
        self._last = (buckets - 1)[:, :, None]
        self._second = buckets[:, 1:]

    def contexts(self, x: F32) -> I64:
        """(predictors, n) context numbers by ascending component, of (width, n) inputs (PassInputs.all)."""
        sums = self._direct @ x
        sums += self._biases
        if len(self._hidden):
            hidden = self._hidden @ x
            hidden += self._hidden_biases
            np.floor(hidden, out=hidden)
            np.maximum(hidden, 0, out=hidden)
            np.minimum(hidden, AMAX, out=hidden)
            sums += self._output @ hidden
        out = np.floor(sums, out=sums).reshape(len(self.components), 2, -1)
        np.maximum(out, 0, out=out)
        np.minimum(out, self._last, out=out)
        return np.asarray(out[:, 0] * self._second + out[:, 1], np.int64)
