"""The .npz anchor model."""

from __future__ import annotations

import io
import pickle
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scarfmt.errors import InvalidInput
from scarfmt.formats import load, save_anchor_npz
from scarfmt.scene.gaussians import AnchorModel
from tests.formats.scene_files import anchor_arrays, anchor_npz, npy, zipped


def read(data: bytes | Path) -> AnchorModel:
    model = load(data)
    assert isinstance(model, AnchorModel)
    return model


def assert_same(a: AnchorModel, b: AnchorModel) -> None:
    for name in ("anchors", "features", "offsets", "log_scaling"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
        assert getattr(a, name).dtype == getattr(b, name).dtype
    assert a.mlps.keys() == b.mlps.keys()
    for name, mlp in a.mlps.items():
        other = b.mlps[name]
        for mine, its in zip((*mlp.weights, *mlp.biases), (*other.weights, *other.biases), strict=True):
            np.testing.assert_array_equal(mine, its)
    assert (a.slot_mask is None) == (b.slot_mask is None)
    if a.slot_mask is not None and b.slot_mask is not None:
        np.testing.assert_array_equal(a.slot_mask, b.slot_mask)


def test_arrays_land_in_their_place() -> None:
    arrays = anchor_arrays()
    model = read(anchor_npz(arrays))
    np.testing.assert_array_equal(model.anchors, arrays["anchor"])
    np.testing.assert_array_equal(model.offsets, arrays["offset"])
    np.testing.assert_array_equal(model.log_scaling, arrays["scaling"])
    np.testing.assert_array_equal(model.mlps["cov"].weights[1], arrays["mlp_cov.2.weight"])
    np.testing.assert_array_equal(model.mlps["color"].biases[0], arrays["mlp_color.0.bias"])
    assert model.slots == 2


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("shift", [0.0, 1e9 + 1e-6])
def test_saved_model_reads_back_exactly(tmp_path: Path, masked: bool, shift: float) -> None:
    """Also with positions that float32 cannot hold."""
    model = read(anchor_npz())
    mask = np.arange(10).reshape(5, 2) % 3 > 0 if masked else None
    model = replace(model, anchors=model.anchors + shift, slot_mask=mask)
    save_anchor_npz(model, tmp_path / "model.npz")
    assert_same(read(tmp_path / "model.npz"), model)
    with pytest.raises(InvalidInput):
        save_anchor_npz(model, tmp_path / "model.npz")


def test_fortran_order_and_other_float_types() -> None:
    arrays = anchor_arrays()
    changed = arrays | {"feat": np.asfortranarray(arrays["feat"]), "anchor": arrays["anchor"].astype(">f8")}
    assert_same(read(anchor_npz(changed)), read(anchor_npz(arrays)))


def test_pickled_arrays_are_never_opened() -> None:
    class Trap:
        def __reduce__(self) -> tuple[object, ...]:
            return (pytest.fail, ("a pickle was executed",))

    arrays = anchor_arrays()
    members = {f"{name}.npy": npy(array) for name, array in arrays.items()}
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "|O", "fortran_order": False, "shape": (1,)})
    members["feat.npy"] = head.getvalue() + pickle.dumps(Trap())
    with pytest.raises(InvalidInput, match="object"):
        load(zipped(members))


@pytest.mark.parametrize("name", ["feat", "offset", "scaling", "anchor", "mlp_cov.2.bias", "mlp_color.0.weight"])
def test_wrong_shape_type_or_absence_names_the_array(name: str) -> None:
    arrays = anchor_arrays()
    flat = arrays | {name: arrays[name].ravel()[:-1]}
    whole = arrays | {name: arrays[name].astype(np.int32)}
    absent = {key: array for key, array in arrays.items() if key != name}
    for broken in (flat, whole, absent):
        with pytest.raises(InvalidInput) as caught:
            load(anchor_npz(broken), format="anchor-npz")
        assert caught.value.field is not None


@pytest.mark.parametrize("shape", [(1 << 40, 3), (-1, 3), (1 << 62, 1 << 62), (5, True)])
def test_declared_shape_is_checked_before_memory_is_allocated(shape: tuple[int, ...]) -> None:
    members = {f"{name}.npy": npy(array) for name, array in anchor_arrays().items()}
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f4", "fortran_order": False, "shape": shape})
    members["anchor.npy"] = head.getvalue() + bytes(60)
    with pytest.raises(InvalidInput):
        load(zipped(members))


def test_only_stored_and_deflated_members_are_read() -> None:
    """Others have no useful bound on what a small file becomes."""
    members = {f"{name}.npy": npy(array) for name, array in anchor_arrays().items()}
    with pytest.raises(InvalidInput, match="deflated"):
        load(zipped(members, zipfile.ZIP_LZMA))
