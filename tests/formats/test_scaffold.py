"""Models of Scaffold-GS's trainer: what is read looks as what was written, and nothing in a checkpoint is run."""

from __future__ import annotations

import io
import pickle
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from reference_decoder.anchors import gaussians
from scarfmt.formats import load
from scarfmt.formats.source import Source
from scarfmt.formats.torch_archive import tensors
from scarfmt.render.camera import look_at
from scarfmt.render.rasterise import render
from scarfmt.scene.gaussians import AnchorModel, Mlp
from tests.formats.scene_files import ply
from tests.reference_decoder.models import random_model
from tests.samples.codec_samples import refuses

torch = pytest.importorskip("torch", reason="writes checkpoints as trainers do: needs the extra neural")

pytestmark = pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")

LAST = {"opacity": "Tanh", "cov": "", "color": "Sigmoid"}
Writer = Callable[[AnchorModel, Path], None]


def source_model(inputs: int = 9) -> AnchorModel:
    return replace(random_model(4, inputs=inputs), slot_mask=None)


def sequential(name: str, mlp: Mlp) -> Any:
    """A network as Scaffold-GS builds it."""
    layers: list[Any] = []
    for weight, bias in zip(mlp.weights, mlp.biases, strict=True):
        layer = torch.nn.Linear(*weight.shape[::-1])
        layer.weight.data, layer.bias.data = torch.from_numpy(weight), torch.from_numpy(bias)
        layers += [layer, torch.nn.ReLU(True)]
    layers[3:] = [getattr(torch.nn, LAST[name])()] if LAST[name] else []
    return torch.nn.Sequential(*layers)


def write_points(model: AnchorModel, folder: Path) -> None:
    """`point_cloud.ply`, with the columns that are of no use."""
    count = len(model)
    zeros = np.zeros((count, 3), np.float32)
    columns = {
        "x y z": model.anchors,
        "nx ny nz": zeros,
        "f_offset_": model.offsets.transpose(0, 2, 1).reshape(count, -1),
        "f_anchor_feat_": model.features,
        "opacity": zeros[:, :1],
        "scale_": model.log_scaling,
        "rot_": np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
    }
    names: list[str] = []
    for prefix, values in columns.items():
        names += [f"{prefix}{k}" for k in range(values.shape[1])] if prefix.endswith("_") else prefix.split()
    folder.mkdir(parents=True, exist_ok=True)
    rows = np.concatenate([values.astype(np.float64) for values in columns.values()], axis=1)
    (folder / "point_cloud.ply").write_bytes(ply([("float", name) for name in names], rows))


def traced(model: AnchorModel, folder: Path) -> None:
    for name, mlp in model.mlps.items():
        network = sequential(name, mlp).eval()
        torch.jit.trace(network, torch.rand(1, mlp.weights[0].shape[1])).save(str(folder / f"{name}_mlp.pt"))


def separate(model: AnchorModel, folder: Path) -> None:
    """State dicts, of a module that has the layers below another name, on a trainer's precision."""
    for name, mlp in model.mlps.items():
        state = sequential(name, mlp).double().state_dict()
        torch.save({f"mlp.{key}": value for key, value in state.items()}, folder / f"{name}_mlp.pth")


def united(model: AnchorModel, folder: Path) -> None:
    parts = {f"{name}_mlp": sequential(name, mlp).state_dict() for name, mlp in model.mlps.items()}
    torch.save(parts, folder / "checkpoints.pth")


def written(model: AnchorModel, folder: Path, networks: Writer = traced) -> Path:
    write_points(model, folder)
    networks(model, folder)
    return folder


def read(path: Path) -> AnchorModel:
    model = load(path)
    assert isinstance(model, AnchorModel)
    return model


def picture(model: AnchorModel) -> np.ndarray[Any, Any]:
    camera = look_at(np.array([0.5, -2.0, 3.0]), np.zeros(3), np.array([0, -1.0, 0]), 48, 36, near=0.05)
    seen = gaussians(model, camera.centre)
    return render(seen.scene, camera, colours=seen.colours)


@pytest.mark.parametrize("networks", [traced, separate, united])
@pytest.mark.parametrize("inputs", [8, 9])
def test_what_is_read_looks_as_what_was_written(tmp_path: Path, networks: Writer, inputs: int) -> None:
    """TorchScript, state dicts and one dictionary of them, with the distance as an input and without."""
    model = source_model(inputs)
    expected = picture(model)
    assert expected.std() > 0.05
    np.testing.assert_allclose(picture(read(written(model, tmp_path, networks))), expected, rtol=0, atol=1e-5)


def test_the_last_iteration_of_a_training_is_read(tmp_path: Path) -> None:
    """By number: 30000 comes after 7000."""
    first, last = source_model(), source_model(8)
    written(first, tmp_path / "point_cloud" / "iteration_7000")
    written(last, tmp_path / "point_cloud" / "iteration_30000")
    np.testing.assert_allclose(picture(read(tmp_path)), picture(last), rtol=0, atol=1e-5)


def test_missing_networks_are_named(tmp_path: Path) -> None:
    written(source_model(), tmp_path)
    (tmp_path / "cov_mlp.pt").unlink()
    refuses("input-mlp", lambda: load(tmp_path), r"cov_mlp\.pt", field="cov")


@pytest.mark.parametrize("name", ["embedding_appearance", "feature_bank_mlp"])
def test_what_gaussians_depend_on_besides_is_refused(tmp_path: Path, name: str) -> None:
    written(source_model(), tmp_path)
    (tmp_path / f"{name}.pt").write_bytes(b"")
    refuses("input-mlp", lambda: load(tmp_path))


def test_appearance_in_a_united_checkpoint_is_refused(tmp_path: Path) -> None:
    write_points(source_model(), tmp_path)
    torch.save({"appearance": {"weight": torch.zeros(3, 3)}}, tmp_path / "checkpoints.pth")
    refuses("input-mlp", lambda: load(tmp_path), "appearance")


def test_networks_of_other_inputs_are_refused(tmp_path: Path) -> None:
    """A level, or an appearance code, beside the direction."""
    refuses("input-mlp", lambda: load(written(source_model(10), tmp_path)), "expected 8 or 9")


def test_points_alone_are_told_what_they_lack(tmp_path: Path) -> None:
    write_points(source_model(), tmp_path)
    refuses("input-mlp", lambda: load((tmp_path / "point_cloud.ply").read_bytes()))


class Trap:
    """Unpickling one would raise."""

    def __reduce__(self) -> tuple[Callable[[str], None], tuple[str]]:
        return (exec, ("raise SystemExit('run')",))


def archive_of(pickled: bytes) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("a/data.pkl", pickled)
    return out.getvalue()


def test_nothing_a_checkpoint_names_is_run() -> None:
    assert tensors(Source(archive_of(pickle.dumps({"a": Trap()}, 2)))) == {}
    with pytest.raises(SystemExit):
        pickle.loads(pickle.dumps(Trap(), 2))


@pytest.mark.parametrize(
    "pickled",
    [
        b"",
        b"\x80\x02",
        b"\x80\x02t.",
        b"\x80\x02K\x01K\x02s.",
        b"\x80\x02h\x07.",
        pickle.dumps([{0.5, 1}], 4),
    ],
)
def test_pickles_that_are_none_or_hold_other_things_are_refused(pickled: bytes) -> None:
    refuses("input-corrupt", lambda: tensors(Source(archive_of(pickled))))


@pytest.mark.parametrize("pickled", [b"\x80\x02]r\xff\xff\xff\xff.", b"cos\nsystem\nX\x02\x00\x00\x00lsR."])
def test_pickles_without_tensors_hold_nothing(pickled: bytes) -> None:
    """What they name is not called, and numbers of memory may be any."""
    assert tensors(Source(archive_of(pickled))) == {}


def tensor_of(size: bytes, stride: bytes, arguments: bytes = b"") -> bytes:
    """A pickle of one tensor over a storage of one float."""
    head = b"\x80\x02}X\x01\0\0\0actorch._utils\n_rebuild_tensor_v2\n("
    storage = b"(X\x07\0\0\0storagectorch\nFloatStorage\nX\x01\0\0\x000X\x03\0\0\0cpuK\x01tQ"
    return head + storage + b"K\0" + size + stride + arguments + b"tRs."


def read_tensor(pickled: bytes) -> dict[str, Any]:
    out = io.BytesIO(archive_of(pickled))
    with zipfile.ZipFile(out, "a") as archive:
        archive.writestr("a/data/0", b"\0\0\x80?")
    return tensors(Source(out.getvalue()))


def test_sizes_are_bounded_numbers_before_anything_is_done_with_them() -> None:
    """Dimensions, arguments and numbers that no network has: refused by a limit, not by what they would cost."""
    one = b"(K\x01t"
    assert read_tensor(tensor_of(one, one))["a"].tolist() == [1.0]
    assert read_tensor(tensor_of(b"(" + b"K\x01" * 8 + b"t", b"(" + b"K\x01" * 8 + b"t"))["a"].shape == (1,) * 8
    for size in (
        b"(" + b"K\x01" * 9 + b"t",
        b"(X\x01\0\0\0at",
        b"(\x8a\x08" + b"\xff" * 7 + b"\x7ft",
        b"(Nt",
        b"K\x01",
        b"(J\xff\xff\xff\xfft",
    ):
        refuses("input-corrupt", lambda size=size: read_tensor(tensor_of(size, one)))
        refuses("input-corrupt", lambda size=size: read_tensor(tensor_of(one, size)))
    refuses("input-corrupt", lambda: read_tensor(tensor_of(one, one, b"N" * 13)))


def test_only_texts_and_numbers_lead_to_tensors() -> None:
    """What is shared many times over is neither hashed nor printed."""
    shared = ()
    for _ in range(4):
        shared = (shared, shared)
    assert tensors(Source(archive_of(pickle.dumps({shared: 1, 2**70: 1, "a": 1}, 2)))) == {}
    for name in (shared, "x" * 300, 5):
        pickled = b"\x80\x04" + pickle.dumps(name, 2)[2:-1] + b"X\x01\0\0\0a\x93."
        refuses("input-corrupt", lambda pickled=pickled: tensors(Source(archive_of(pickled))))
    nested: dict[str, Any] = {}
    for _ in range(100):
        nested = {"": nested}
    assert tensors(Source(archive_of(pickle.dumps(nested, 2)))) == {}
