"""The bytes of a file depend neither on torch and Pillow nor, but for last bits, on BLAS."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from reference_decoder.decode import decode
from reference_encoder.encode import EncodeOptions, encode
from scarfmt.formats import load
from scarfmt.scene.gaussians import GaussianScene

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "plush-toys.ply"
EVERY = 12
"""One Gaussian of so many is kept: the whole scene takes half a minute."""
Cases = dict[str, dict[str, int]]
CASES: Cases = {"effort 1": {"effort": 1, "corrections": 0}, "effort 2": {"effort": 2, "corrections": 0}}
CHILD = """
import json, sys
from pathlib import Path
if sys.argv[1] == "without torch":
    sys.modules["torch"] = sys.modules["PIL"] = None
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


def test_explicit_scenes_need_neither_torch_nor_pillow(tmp_path: Path) -> None:
    """A part of the example scene at efforts 1 and 2: one file with and without, too small for a thumbnail."""
    whole = load(EXAMPLE)
    assert isinstance(whole, GaussianScene)
    scene = whole.take(np.arange(0, len(whole), EVERY))
    found = _encoded_elsewhere(tmp_path / "files", CASES, "without torch")
    assert found == {name: encode(scene, EncodeOptions(**options)) for name, options in CASES.items()}


def test_another_blas_kernel_changes_last_bits_at_most(tmp_path: Path) -> None:
    """Two kernels of OpenBLAS, with and without fused multiply-add: values agree within the tolerance of SPEC §9.5."""
    cases = {"effort 1": CASES["effort 1"]}
    one, two = (
        decode(_encoded_elsewhere(tmp_path / kernel, cases, OPENBLAS_CORETYPE=kernel)["effort 1"]).scene
        for kernel in ("Haswell", "Prescott")
    )
    assert len(one) == len(two) > 700
    for attribute in ("positions", "log_scales", "rotations", "opacity_logits", "sh"):
        np.testing.assert_allclose(getattr(one, attribute), getattr(two, attribute), rtol=1e-5, atol=1e-5)
