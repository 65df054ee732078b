"""The faults that are refused, and those that are dropped, before encoding."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

from scarfmt.errors import InputWarning, InvalidInput
from scarfmt.formats.clean import MAX_COEFFICIENT, clean
from scarfmt.formats.quantise import opacities
from scarfmt.scene.gaussians import AnchorModel, GaussianScene, Mlp
from tests.samples.codec_samples import refuses

ATTRIBUTES = ("positions", "log_scales", "rotations", "opacity_logits", "sh")
ANCHOR_ATTRIBUTES = ("anchors", "features", "offsets", "log_scaling")

EDGES = {("opacity_logits", np.inf), ("opacity_logits", -np.inf), ("log_scales", -np.inf)}


def scene(count: int = 5) -> GaussianScene:
    f32 = np.float32
    ones = np.ones((count, 4), f32)
    positions = np.arange(3.0 * count).reshape(count, 3)
    return GaussianScene(positions, ones[:, :3].copy(), ones.copy(), ones[:, 0].copy(), np.ones((count, 4, 3), f32))


def model(count: int = 5) -> AnchorModel:
    f32 = np.float32
    mlp = Mlp((np.ones((2, 5), f32), np.ones((2, 2), f32)), (np.ones(2, f32), np.ones(2, f32)))
    anchors = np.arange(3.0 * count).reshape(count, 3)
    mask = np.arange(2 * count).reshape(count, 2) % 3 == 0
    offsets, scaling = np.ones((count, 2, 3), f32), np.ones((count, 6), f32)
    return AnchorModel(anchors, np.ones((count, 1), f32), offsets, scaling, {"opacity": mlp}, mask)


@pytest.mark.parametrize("good", [scene(), model()])
def test_good_scene_is_returned_itself(good: GaussianScene | AnchorModel) -> None:
    assert clean(good) == (good, 0)


@pytest.mark.parametrize("empty", [scene(0), model(0)])
@pytest.mark.parametrize("drop", [False, True])
def test_empty_scene_is_refused(empty: GaussianScene | AnchorModel, drop: bool) -> None:
    """So is one of which nothing is left."""
    refuses("input-empty", lambda: clean(empty, drop_invalid=drop))
    lost = replace(scene(), positions=np.full((5, 3), np.nan))
    refuses("input-empty", lambda: clean(lost, drop_invalid=True))


@pytest.mark.parametrize("attribute", ATTRIBUTES + ANCHOR_ATTRIBUTES)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_not_finite_is_refused_with_count_and_place_or_dropped(attribute: str, value: float) -> None:
    if (attribute, value) in EDGES:
        return
    damaged = scene() if attribute in ATTRIBUTES else model()
    getattr(damaged, attribute)[[1, 3], ...] = value
    with pytest.raises(InvalidInput, match=r"2 of 5 rows.*first is row 1.*--drop-invalid") as caught:
        clean(damaged)
    assert caught.value.refusal == "input-not-finite"
    with warnings.catch_warnings(record=True) as told:
        kept, dropped = clean(damaged, drop_invalid=True)
    assert dropped == 2
    if attribute in ATTRIBUTES:
        seen = "none of them visible" if attribute == "opacity_logits" else "2 of these 2 visible"
        assert seen in str(caught.value)
        assert seen in str(told[0].message)
    names = ATTRIBUTES if isinstance(damaged, GaussianScene) else (*ANCHOR_ATTRIBUTES, "slot_mask")
    for name in names:
        np.testing.assert_array_equal(getattr(kept, name), getattr(damaged, name)[[0, 2, 4]])


def test_infinities_that_mean_something_are_values() -> None:
    """Exporters write logit(1) as inf and log(0) as -inf: these rows are the most visible ones of a scene."""
    edge = scene()
    edge.opacity_logits[[0, 1]] = np.inf, -np.inf
    edge.log_scales[2, 1] = -np.inf
    with pytest.warns(InputWarning) as told:
        kept, dropped = clean(edge)
    assert dropped == 0
    assert not kept.invalid_rows().any()
    assert [str(warning.message).split(":")[0] for warning in told] == [
        "2 of 5 Gaussians have an infinite opacity logit",
        "1 of 5 Gaussians have a size of 0 along an axis",
    ]
    np.testing.assert_allclose(opacities(kept.opacity_logits)[:2], [1, 0], atol=1e-8)
    assert np.exp(kept.log_scales[2, 1]) < 1e-8
    np.testing.assert_array_equal(kept.log_scales[2, [0, 2]], edge.log_scales[2, [0, 2]])
    assert np.isinf(edge.opacity_logits[0]), "the scene that was given is not changed"


def test_rows_of_zeros_are_counted_and_kept() -> None:
    zeros = scene()
    zeros.positions[0] = zeros.positions[3] = 0
    for values in (zeros.log_scales, zeros.rotations, zeros.opacity_logits, zeros.sh):
        values[[0, 3]] = 0
    zeros.rotations[1] = 0
    with pytest.warns(InputWarning) as told:
        assert clean(zeros) == (zeros, 0)
    assert [str(warning.message)[:42] for warning in told] == [
        "2 of 5 Gaussians are rows of zeros, as som",
        "1 of 5 Gaussians have a rotation of length",
    ]


def test_damaged_network_cannot_be_dropped() -> None:
    damaged = model()
    damaged.mlps["opacity"].biases[1][0] = np.inf
    refuses("input-not-finite", lambda: clean(damaged, drop_invalid=True), field="mlps.opacity")


@pytest.mark.parametrize(("place", "name"), [((2, 0, 1), "f_dc_1"), ((2, 1, 0), "f_rest_0"), ((2, 3, 2), "f_rest_8")])
def test_a_coefficient_out_of_all_range_is_refused_by_name_or_dropped(place: tuple[int, int, int], name: str) -> None:
    """No file's integers can hold it beside other Gaussians; the largest accepted value can be held."""
    damaged = scene()
    damaged.sh[place] = -3.4e38
    with pytest.raises(InvalidInput, match=r"row 2 is -3.4e\+38; at most \+-1,048,576 .*--drop-invalid") as caught:
        clean(damaged)
    assert (caught.value.refusal, caught.value.field) == ("input-range", name)
    kept, dropped = clean(damaged, drop_invalid=True)
    assert (dropped, len(kept)) == (1, 4)
    damaged.sh[place] = MAX_COEFFICIENT
    assert clean(damaged) == (damaged, 0)
