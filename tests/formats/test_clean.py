"""The faults that are refused, and those that are dropped, before encoding."""

from __future__ import annotations

import numpy as np
import pytest

from scarfmt.errors import InvalidInput
from scarfmt.formats.clean import MAX_COEFFICIENT, clean
from scarfmt.scene.gaussians import AnchorModel, GaussianScene, Mlp

ATTRIBUTES = ("positions", "log_scales", "rotations", "opacity_logits", "sh")
ANCHOR_ATTRIBUTES = ("anchors", "features", "offsets", "log_scaling")


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
    with pytest.raises(InvalidInput) as caught:
        clean(empty, drop_invalid=drop)
    assert caught.value.refusal == "input-empty"


@pytest.mark.parametrize("attribute", ATTRIBUTES + ANCHOR_ATTRIBUTES)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_not_finite_is_refused_with_count_and_place_or_dropped(attribute: str, value: float) -> None:
    damaged = scene() if attribute in ATTRIBUTES else model()
    getattr(damaged, attribute)[[1, 3], ...] = value
    with pytest.raises(InvalidInput, match=r"2 of 5 rows.*first is row 1.*--drop-invalid") as caught:
        clean(damaged)
    assert caught.value.refusal == "input-not-finite"
    kept, dropped = clean(damaged, drop_invalid=True)
    assert dropped == 2
    names = ATTRIBUTES if isinstance(damaged, GaussianScene) else (*ANCHOR_ATTRIBUTES, "slot_mask")
    for name in names:
        np.testing.assert_array_equal(getattr(kept, name), getattr(damaged, name)[[0, 2, 4]])


def test_nothing_left_is_an_empty_scene() -> None:
    damaged = scene()
    damaged.positions[:] = np.nan
    with pytest.raises(InvalidInput) as caught:
        clean(damaged, drop_invalid=True)
    assert caught.value.refusal == "input-empty"


def test_damaged_network_cannot_be_dropped() -> None:
    damaged = model()
    damaged.mlps["opacity"].biases[1][0] = np.inf
    with pytest.raises(InvalidInput) as caught:
        clean(damaged, drop_invalid=True)
    assert (caught.value.refusal, caught.value.field) == ("input-not-finite", "mlps.opacity")


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
