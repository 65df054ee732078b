"""The bytes of a file depend neither on torch, where no network is trained, nor, but for last bits, on BLAS."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from reference_decoder.decode import decode
from reference_encoder.encode import EncodeOptions, encode
from reference_encoder.pipeline import check_torch
from scarfmt.errors import InvalidInput
from scarfmt.formats import load
from scarfmt.scene.gaussians import AnchorModel, GaussianScene
from tests.reference_encoder.profiles.test_anchors import small_model

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "plush-toys.ply"
EVERY = 12
"""One Gaussian of so many is kept: the whole scene takes half a minute."""
Cases = dict[str, dict[str, int]]
WITHOUT_NETWORKS: Cases = {
    "effort 1": {"effort": 1, "corrections": 0},
    "budget 0": {"decode_budget": 0, "corrections": 0},
}
CHILD = """
import json, sys
from pathlib import Path
if sys.argv[1] == "without torch":
    sys.modules["torch"] = None
import numpy as np
from reference_encoder.encode import EncodeOptions, encode
from scarfmt.formats import load
scene = load(sys.argv[2])
scene = scene.take(np.arange(0, len(scene), int(sys.argv[4])))
for name, options in json.loads(sys.argv[5]).items():
    Path(sys.argv[3], name).write_bytes(encode(scene, EncodeOptions(**options)))
"""


def _encoded_elsewhere(folder: Path, cases: Cases, torch: str = "with torch", **environment: str) -> dict[str, bytes]:
    """Files of a part of the example scene, made in a process of its own."""
    folder.mkdir()
    command = [sys.executable, "-c", CHILD, torch, str(EXAMPLE), str(folder), str(EVERY), json.dumps(cases)]
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "PYTHONPATH": path, **environment}
    subprocess.run(command, env=environment, cwd=ROOT, check=True, capture_output=True)
    return {name: (folder / name).read_bytes() for name in cases}


def test_files_without_networks_need_no_torch_and_are_the_same(tmp_path: Path) -> None:
    """A part of the example scene at effort 1 and at effort 2 with a budget of 0."""
    whole = load(EXAMPLE)
    assert isinstance(whole, GaussianScene)
    scene = whole.take(np.arange(0, len(whole), EVERY))
    found = _encoded_elsewhere(tmp_path / "files", WITHOUT_NETWORKS, "without torch")
    assert found == {name: encode(scene, EncodeOptions(**options)) for name, options in WITHOUT_NETWORKS.items()}


@pytest.mark.parametrize("options", [EncodeOptions(), EncodeOptions(effort=1, latent="learned")])
def test_missing_torch_is_told_before_the_work_with_what_does_without(
    options: EncodeOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line: what is missing, how it is installed, what needs none."""
    monkeypatch.setitem(sys.modules, "torch", None)
    scene = load(EXAMPLE)
    assert isinstance(scene, GaussianScene)
    with pytest.raises(InvalidInput, match=r"torch.*neural.*--(effort 1|latent learned)") as caught:
        encode(scene, options)
    assert caught.value.refusal == "input-dependency"
    assert "\n" not in str(caught.value)
    check_torch(scene, EncodeOptions(effort=1))


def test_anchor_models_are_not_measured_without_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    """At no effort: their own networks are measured with it."""
    model = small_model()
    assert isinstance(model, AnchorModel)
    check_torch(model, EncodeOptions(effort=1))
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(InvalidInput, match="anchor model"):
        check_torch(model, EncodeOptions(effort=1))


def test_another_blas_kernel_changes_last_bits_at_most(tmp_path: Path) -> None:
    """Two kernels of OpenBLAS, with and without fused multiply-add: values agree within the tolerance of SPEC §9.5."""
    cases = {"effort 1": WITHOUT_NETWORKS["effort 1"]}
    files = {
        kernel: _encoded_elsewhere(tmp_path / kernel, cases, OPENBLAS_CORETYPE=kernel)
        for kernel in ("Haswell", "Prescott")
    }
    for name in cases:
        one, two = (decode(files[kernel][name]).scene for kernel in files)
        assert isinstance(one, GaussianScene)
        assert isinstance(two, GaussianScene)
        assert len(one) == len(two) > 700
        for attribute in ("positions", "log_scales", "rotations", "opacity_logits", "sh"):
            np.testing.assert_allclose(getattr(one, attribute), getattr(two, attribute), rtol=1e-5, atol=1e-5)
