"""Choosing context rules: by counts made once for many rules, the same choice as by coding under each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from reference_encoder.decide import contexts as chooser
from reference_encoder.decide.allocate import entropy_bits
from reference_encoder.decide.contexts import choose_rules
from scarfmt.arrays import I64
from scarfmt.codecs.channels import contexts
from scarfmt.container.schema import Stream
from scarfmt.scene.model import NO_SOURCE, ContextRule

STREAMS = [Stream.POSITION_RESIDUAL, Stream.SCALE, Stream.OPACITY]


def values(seed: int, wide: bool) -> tuple[list[I64], I64]:
    """First-step values of three channels, some predictable from others and some from the class; and the classes."""
    draw = np.random.default_rng(seed)
    classes = draw.integers(0, 3, 4000)
    scale = np.rint(draw.normal(0, 400 if wide else 6, (4000, 3))).astype(np.int64)
    scale[:, 1] = scale[:, 0] + draw.integers(-1, 2, 4000)
    opacity = (4 * classes + draw.integers(0, 2, 4000))[:, None]
    return [draw.integers(-1, 2, (4000, 3)), scale, opacity], classes


def bits(rule: ContextRule, column: I64, firsts: list[I64], classes: I64) -> float:
    """Bits of a component under a rule, tables included."""
    return entropy_bits(column, contexts(rule, classes, [first.astype(np.int32) for first in firsts]))


@pytest.mark.parametrize("wide", [False, True])
@pytest.mark.parametrize("bins", [0, 1 << 20])
def test_no_other_rule_of_a_chosen_source_is_cheaper(wide: bool, bins: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """With and without the class, with the source and without it; whether counts are dense or sorted."""
    monkeypatch.setattr(chooser, "_MOST_BINS", bins)
    firsts, classes = values(1, wide)
    for channel, rules in enumerate(choose_rules(STREAMS, firsts, classes)):
        for component, rule in enumerate(rules):
            others = [ContextRule(by_class=flag) for flag in (False, True)]
            others += [replace(rule, by_class=not rule.by_class)]
            column = firsts[channel][:, component]
            least = bits(rule, column, firsts, classes)
            assert all(least <= bits(other, column, firsts, classes) + 1e-6 for other in others)


def test_the_source_that_tells_most_is_found() -> None:
    """A copied component; a component of its class alone; residuals neither have nor are a source."""
    firsts, classes = values(2, wide=False)
    residual, scale, opacity = choose_rules(STREAMS, firsts, classes)
    assert all(rule.source_channel == NO_SOURCE for rule in residual)
    assert (scale[1].source_channel, scale[1].source_component) == (1, 0)
    assert opacity[0].by_class
    assert opacity[0].source_channel == NO_SOURCE


def test_nothing_to_code_has_rules_too() -> None:
    """A scene may lose all anchors of a sample."""
    assert choose_rules(STREAMS[1:2], [np.zeros((0, 3), np.int64)], np.zeros(0, np.int64)) == [
        (ContextRule(by_class=False),) * 3
    ]
