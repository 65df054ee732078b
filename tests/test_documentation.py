"""Every Python example in README.md and docs/ runs, so that none can name what is gone."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from reference_encoder.encode import encode
from reference_encoder.options import EncodeOptions
from scarfmt.formats import load
from scarfmt.formats.export_ply import write_inria_ply
from scarfmt.scene.gaussians import GaussianScene
from tests.conftest import REPOSITORY

FENCE = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
PAGES = [REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").glob("**/*.md"))]
WITH_EXAMPLES = [page for page in PAGES if FENCE.search(page.read_text(encoding="utf-8"))]
FEW = 400


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `scene.ply`, some Gaussians of the example scene, and `scene.scar` made of it."""
    made = tmp_path_factory.mktemp("examples")
    scene = load(REPOSITORY / "examples" / "plush-toys.ply")
    assert isinstance(scene, GaussianScene)
    few = scene.take(np.arange(0, len(scene), len(scene) // FEW))
    with (made / "scene.ply").open("wb") as target:
        write_inria_ply(few, target)
    (made / "scene.scar").write_bytes(encode(few, EncodeOptions(effort=1, corrections=0, layers=3)))
    return made


@pytest.mark.parametrize("page", WITH_EXAMPLES, ids=lambda page: str(page.relative_to(REPOSITORY)))
def test_examples_run(page: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    text = page.read_text(encoding="utf-8")
    namespace: dict[str, object] = {}
    for block in FENCE.finditer(text):
        lines_before = text.count("\n", 0, block.start(1))
        exec(compile("\n" * lines_before + block[1], str(page), "exec"), namespace)


def test_the_page_of_the_api_has_examples() -> None:
    """Else a change of how examples are fenced would leave nothing to run."""
    assert {"README.md", "api.md"} <= {page.name for page in WITH_EXAMPLES}
