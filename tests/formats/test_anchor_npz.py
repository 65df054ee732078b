"""The .npz anchor model."""

from __future__ import annotations

import io
import math
import pickle
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scarfmt.errors import InvalidInput
from scarfmt.formats import load
from scarfmt.formats.anchor_npz import save_anchor_npz
from scarfmt.scene.gaussians import AnchorModel
from tests.formats.scene_files import anchor_arrays, anchor_npz, npy, zipped
from tests.samples.codec_samples import refuses
from tests.samples.equality import same


def read(data: bytes | Path) -> AnchorModel:
    model = load(data)
    assert isinstance(model, AnchorModel)
    return model


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
    """Positions that float32 cannot hold come back, too."""
    model = read(anchor_npz())
    mask = np.arange(10).reshape(5, 2) % 3 > 0 if masked else None
    model = replace(model, anchors=model.anchors + shift, slot_mask=mask)
    save_anchor_npz(model, tmp_path / "model.npz")
    assert same(read(tmp_path / "model.npz"), model)
    refuses("output-exists", lambda: save_anchor_npz(model, tmp_path / "model.npz"))


def test_fortran_order_and_other_float_types() -> None:
    arrays = anchor_arrays()
    changed = arrays | {"feat": np.asfortranarray(arrays["feat"]), "anchor": arrays["anchor"].astype(">f8")}
    assert same(read(anchor_npz(changed)), read(anchor_npz(arrays)))


def test_a_member_that_is_damaged_is_refused() -> None:
    arrays = anchor_arrays()
    data = zipped({f"{name}.npy": npy(array) for name, array in arrays.items()})
    refuses("input-corrupt", lambda: load(data.replace(arrays["feat"].tobytes(), bytes(60))), "damaged archive member")


def test_pickled_arrays_are_never_opened() -> None:
    class Trap:
        def __reduce__(self) -> tuple[object, ...]:
            return (pytest.fail, ("a pickle was executed",))

    arrays = anchor_arrays()
    members = {f"{name}.npy": npy(array) for name, array in arrays.items()}
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "|O", "fortran_order": False, "shape": (1,)})
    members["feat.npy"] = head.getvalue() + pickle.dumps(Trap())
    refuses("input-corrupt", lambda: load(zipped(members)), "object")


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


HUGE = [(1 << 40, 3), (-1, 3), (1 << 62, 1 << 62), (5, True)]
WITH_RIGHT_BYTES = [(-5, -3), (-5, -2), (0, -1), (0, 1 << 70), (0, 1 << 40, 1 << 40), (True, True), (1,) * 70]


@pytest.mark.parametrize("member", ["anchor", "offset", "slot_mask"])
@pytest.mark.parametrize("shape", HUGE + WITH_RIGHT_BYTES, ids=lambda shape: str(shape)[:20])
def test_impossible_shapes_are_damage(shape: tuple[int, ...], member: str) -> None:
    """Before memory is allocated for them, and where there are as many bytes as they ask for."""
    arrays = anchor_arrays() | {"slot_mask": np.ones((5, 2), np.bool_)}
    members = {f"{name}.npy": npy(array) for name, array in arrays.items()}
    head = io.BytesIO()
    kind = "|b1" if member == "slot_mask" else "<f4"
    np.lib.format.write_array_header_1_0(head, {"descr": kind, "fortran_order": False, "shape": shape})
    body = 60 if shape in HUGE else math.prod(shape) * np.dtype(kind).itemsize
    members[f"{member}.npy"] = head.getvalue() + bytes(body)
    refuses("input-corrupt", lambda: load(zipped(members)), field=member)


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': '<f4', 'fortran_order': False, 'shape': (" + "9" * 5000 + ",)}",
        "{'descr': [], 'fortran_order': False, 'shape': (5, 3)}",
        "{'descr': [('a', '<f4'), ('a', '<f4')], 'fortran_order': False, 'shape': (5, 3)}",
        "{'descr': {}, 'fortran_order': False, 'shape': (5, 3)}",
        "{'descr': ('<f4', (3,)), 'fortran_order': False, 'shape': (5, 3)}",
        "{'descr': ('<f4', 1 << 70), 'fortran_order': False, 'shape': (5, 3)}",
        "{'descr': None, 'fortran_order': False, 'shape': (5, 3)}",
        "{'descr': '<f4', 'fortran_order': 2, 'shape': (5, 3)}",
        "{'descr': '<f4', 'fortran_order': False, 'shape': 5}",
        "{'descr': '<f4', 'fortran_order': False, 'shape': (5, 3) + (1,)}",
        "[" * 3000,
        "",
    ],
    ids=lambda header: header[:40],
)
def test_odd_headers_are_damage(header: str) -> None:
    """numpy evaluates them as Python literals, which fail in many ways."""
    members = {f"{name}.npy": npy(array) for name, array in anchor_arrays().items()}
    text = header.encode() + b"\n"
    members["anchor.npy"] = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + bytes(60)
    with pytest.raises(InvalidInput) as caught:
        load(zipped(members))
    assert caught.value.refusal == "input-corrupt"
    assert "object at" not in caught.value.message


@pytest.mark.parametrize("extra", [3, 4])
def test_networks_take_the_distance_or_not(extra: int) -> None:
    """Scaffold-GS's add_*_dist options: all three alike."""
    arrays = anchor_arrays(extra=extra)
    model = read(anchor_npz(arrays))
    assert model.mlps["color"].weights[0].shape == (4, 3 + extra)
    arrays["mlp_cov.0.weight"] = arrays["mlp_cov.0.weight"][:, :-1]
    refuses("input-corrupt", lambda: load(anchor_npz(arrays)), "the same for all")


def test_only_stored_and_deflated_members_are_read() -> None:
    """Others have no useful bound on what a small file becomes."""
    members = {f"{name}.npy": npy(array) for name, array in anchor_arrays().items()}
    refuses("input-format", lambda: load(zipped(members, zipfile.ZIP_LZMA)))
