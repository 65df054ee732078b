"""A model as Scaffold-GS's trainer leaves it: a folder with `point_cloud.ply` and the checkpoints of three networks.

The PLY has one vertex for each of N anchors, K slots and D features:

- ``x y z``: position; ``f_anchor_feat_0..``: D features;
- ``f_offset_0..``: 3K numbers, the first coordinate of all K slots, then the second, then the third;
- ``scale_0..5``: natural logs. ``opacity``, ``rot_*`` and normals are of no use.

Beside it are the networks, each in a file (`opacity_mlp.pt`, `cov_mlp.pt`, `color_mlp.pt`: TorchScript or a state dict)
or all in one dictionary, `checkpoints.pth`. Inputs, outputs and meaning are those of
:mod:`scarfmt.formats.anchor_npz`; the order of layers is that of the numbers in their names. Nothing is unpickled
(:mod:`scarfmt.formats.torch_archive`). The folder may also be that of the whole training: then the last
`point_cloud/iteration_*` is read.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scarfmt.errors import InvalidInput
from scarfmt.formats import ply
from scarfmt.formats.source import Source
from scarfmt.formats.torch_archive import tensors
from scarfmt.scene.gaussians import AnchorModel, Mlp

POINTS = "point_cloud.ply"
_UNITED = "checkpoints.pth"
_OUTPUTS_PER_SLOT = {"opacity": 1, "cov": 7, "color": 3}
_ENDINGS = (".pt", ".pth")
# What such a model may have besides, and no file of ours can hold.
_OTHERS = {"embedding_appearance": "appearance embeddings", "appearance": "appearance embeddings"}
_OTHERS |= {"feature_bank_mlp": "a feature bank", "mlp_feature_bank": "a feature bank"}

Tensors = dict[str, NDArray[np.floating]]


def points_of(folder: Path) -> Path | None:
    """The `point_cloud.ply` of a folder of a model or of its training; None where there is none."""
    if (folder / POINTS).is_file():
        return folder / POINTS
    known = []
    for path in folder.glob(f"point_cloud/iteration_*/{POINTS}"):
        number = path.parent.name.rpartition("_")[2]
        if number.isdecimal():
            known.append((int(number), path))
    return max(known)[1] if known else None


def sniff(source: Source) -> bool:
    """Whether the content is a PLY of anchors."""
    if not ply.is_ply(source):
        return False
    try:
        vertex = ply.read_header(source).elements.get("vertex")
    except InvalidInput:
        return False
    return vertex is not None and "f_anchor_feat_0" in vertex.properties


def load(source: Source) -> AnchorModel:
    """Read the anchors, and the networks beside them.

    Raises:
        InvalidInput: ``input-mlp``: networks are missing, of the wrong shape, or take what files of ours cannot hold;
            ``input-corrupt``.
        LimitExceeded: more anchors than any scene has.
    """
    header = ply.read_header(source)
    vertex = header.elements.get("vertex")
    names = [] if vertex is None else [name for name, kind in vertex.properties.items() if kind != ply.LIST]
    features, offsets = _number(source, names, "f_anchor_feat_"), _number(source, names, "f_offset_")
    scales = [f"scale_{axis}" for axis in range(6)]
    missing = [name for name in ("x", "y", "z", *scales, "f_offset_0") if name not in names]
    if missing or len(offsets) % 3:
        what = f"the vertices lack {', '.join(missing)}" if missing else f"{len(offsets)} offsets, not 3 for each slot"
        raise source.corrupt(f"no PLY of Scaffold-GS: {what}", field="vertex")
    slots = len(offsets) // 3
    mlps = _networks(source, len(features), slots)
    rows = ply.read_elements(source, header, ["vertex"])["vertex"]
    with np.errstate(over="ignore"):  # doubles beyond float32 become infinities, which a later check reports
        by_axis = ply.columns(rows, offsets).astype(np.float32).reshape(len(rows), 3, slots)
        return AnchorModel(
            ply.columns(rows, ["x", "y", "z"]).astype(np.float64),
            ply.columns(rows, features).astype(np.float32),
            np.ascontiguousarray(by_axis.transpose(0, 2, 1)),
            ply.columns(rows, scales).astype(np.float32),
            mlps,
        )


def _number(source: Source, names: list[str], prefix: str) -> list[str]:
    """The columns PREFIX0, PREFIX1, ... in order of their numbers."""
    count = sum(name.startswith(prefix) for name in names)
    wanted = [f"{prefix}{number}" for number in range(count)]
    if not set(wanted) <= set(names):
        raise source.corrupt(f"the {prefix}* of the vertices are not numbered from 0", field="vertex")
    return wanted


def _networks(source: Source, width: int, slots: int) -> dict[str, Mlp]:
    """The three networks, of D + 4 inputs, or all of D + 3; `width` is D."""
    if source.path is None:
        raise InvalidInput(
            "input-mlp", f"{source.name}: anchors without networks; give the folder that {POINTS} is in", field="mlps"
        )
    found = _checkpoints(source, source.path.parent)
    mlps = {name: _network(source, name, found[name], outputs * slots) for name, outputs in _OUTPUTS_PER_SLOT.items()}
    inputs = {name: mlp.weights[0].shape[1] for name, mlp in mlps.items()}
    if set(inputs.values()) not in ({width + 3}, {width + 4}):
        message = f"networks of {inputs} inputs, expected {width + 3} or {width + 4}, the same for all"
        advice = "train without appearance embeddings, levels, or distances that only some networks take"
        raise InvalidInput("input-mlp", f"{source.name}: {message}; {advice}", field="mlps")
    return mlps


def _checkpoints(source: Source, folder: Path) -> dict[str, Tensors]:
    """Tensors of each network, by its short name."""
    for name, what in _OTHERS.items():
        if any((folder / f"{name}{ending}").exists() for ending in _ENDINGS):
            raise _unsupported(source, what)
    if (folder / _UNITED).is_file():
        return _unite(source, tensors(Source(folder / _UNITED)))
    found = {}
    for name in _OUTPUTS_PER_SLOT:
        paths = [folder / f"{name}_mlp{ending}" for ending in _ENDINGS]
        path = next((path for path in paths if path.is_file()), None)
        if path is None:
            message = f"{source.name}: {paths[0].name} is not beside it; copy all three networks there"
            raise InvalidInput("input-mlp", message, field=name)
        found[name] = tensors(Source(path))
    return found


def _unite(source: Source, everything: Tensors) -> dict[str, Tensors]:
    """The parts of one dictionary of all networks."""
    found: dict[str, Tensors] = {name: {} for name in _OUTPUTS_PER_SLOT}
    for path, tensor in everything.items():
        first, _, rest = path.partition(".")
        if first in _OTHERS:
            raise _unsupported(source, _OTHERS[first])
        short = first.removesuffix("_mlp").removeprefix("mlp_")
        if short in found:
            found[short][rest] = tensor
    return found


def _network(source: Source, name: str, found: Tensors, outputs: int) -> Mlp:
    """The perceptron of one hidden layer that some tensors make, whatever comes before the numbers of its layers."""
    layers = sorted({path.rpartition(".")[0] for path in found}, key=_by_number)
    wanted = [f"{layer}.{part}" if layer else part for layer in layers for part in ("weight", "bias")]
    if len(layers) != 2 or set(wanted) != set(found):
        message = f"{source.name}: the {name} network is not two linear layers with biases, but {sorted(found)[:8]}"
        raise InvalidInput("input-mlp", message, field=name)
    with np.errstate(over="ignore"):
        first, first_bias, second, second_bias = (found[path].astype(np.float32) for path in wanted)
    hidden, inputs = first.shape if first.ndim == 2 else (0, 0)
    shapes = [array.shape for array in (first, first_bias, second, second_bias)]
    if shapes != [(hidden, inputs), (hidden,), (outputs, hidden), (outputs,)]:
        message = f"{source.name}: the {name} network has layers {shapes}, expected {outputs} outputs"
        raise InvalidInput("input-mlp", message, field=name)
    return Mlp((first, second), (first_bias, second_bias))


def _by_number(layer: str) -> list[int]:
    return [int(number) for number in re.findall(r"[0-9]{1,9}", layer)]


def _unsupported(source: Source, what: str) -> InvalidInput:
    message = f"{source.name}: the model has {what}, which a .scar cannot hold; train without"
    return InvalidInput("input-mlp", message, field="mlps")
