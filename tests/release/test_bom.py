"""The bill of materials lists what wheel and npm package hold and need, and nothing that they do not."""

from __future__ import annotations

import io
import json
import re
import tarfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from release.bom import COMPONENTS, list_bundled, write_bill
from release.tree import Tree
from scarfmt.viewer.offers import PAGE
from tests.conftest import REPOSITORY

METADATA = """Metadata-Version: 2.4
Name: scarfmt
Version: 1.2.3
Requires-Dist: numpy>=2
Requires-Dist: pillow>=10; extra == "import"
Requires-Dist: scarfmt[encode]; extra == "neural"
"""
BUNDLED = [
    {"name": "@x/drawer", "version": "1.0.0", "licence": "MIT", "kind": "npm"},
    {"name": "inner", "version": None, "licence": "Zlib", "kind": "cargo"},
]


def _released(out: Path, dependencies: Mapping[str, str], metadata: str = METADATA) -> Tree:
    """The artefacts that a bill is written from, and a tree of that version."""
    with zipfile.ZipFile(out / "scarfmt-1.2.3-py3-none-any.whl", "w") as wheel:
        wheel.writestr(COMPONENTS, json.dumps(BUNDLED))
        wheel.writestr("scarfmt-1.2.3.dist-info/METADATA", metadata)
    described = json.dumps({"name": "scar-stream", "dependencies": dependencies}).encode()
    with tarfile.open(out / "scar-stream-1.2.3.tgz", "w:gz") as package:
        entry = tarfile.TarInfo("package/package.json")
        entry.size = len(described)
        package.addfile(entry, io.BytesIO(described))
    (out / "tree" / "scarfmt").mkdir(parents=True)
    (out / "tree" / "scarfmt" / "__init__.py").write_text('__version__ = "1.2.3"\n')
    return Tree(out / "tree", 1_700_000_000)


def test_a_bill_has_what_is_bundled_and_what_is_required(tmp_path: Path) -> None:
    bill: dict[str, Any] = json.loads(write_bill(_released(tmp_path, {}), tmp_path).read_text())
    wheel, npm, *required = bill["components"]
    held = [(one["name"], one.get("version")) for one in wheel["components"]]
    assert held == [("@x/drawer", "1.0.0"), ("inner", None)]
    assert [one["purl"] for one in wheel["components"]] == ["pkg:npm/%40x/drawer@1.0.0", "pkg:cargo/inner"]
    assert npm["purl"] == "pkg:npm/scar-stream@1.2.3"
    assert [(one["name"], one["scope"]) for one in required] == [("numpy", "required"), ("pillow", "optional")]
    assert bill["metadata"]["timestamp"] == "2023-11-14T22:13:20Z"


def test_extras_need_not_bring_each_other(tmp_path: Path) -> None:
    alone = METADATA[: METADATA.index("Requires-Dist: scarfmt")]
    bill = json.loads(write_bill(_released(tmp_path, {}, alone), tmp_path).read_text())
    assert [one["name"] for one in bill["components"][2:]] == ["numpy", "pillow"]


def test_a_dependency_of_the_npm_package_is_not_forgotten(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="dependencies"):
        write_bill(_released(tmp_path, {"left-pad": "1"}), tmp_path)


def test_a_bundle_without_a_list_is_no_release(tmp_path: Path) -> None:
    wheel = tmp_path / "scarfmt-1.2.3-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w"):
        pass
    with pytest.raises(KeyError):
        list_bundled(wheel)


@pytest.mark.skipif(not (Path(str(PAGE)) / "components.json").exists(), reason="the page is not built: make web")
def test_the_page_lists_what_is_found_in_its_files() -> None:
    """Looked for in another way than the build does: by words of each library, and by names of crates in the module."""
    page = Path(str(PAGE))
    listed = {(one["kind"], one["name"]) for one in json.loads((page / "components.json").read_text())}
    scripts = "".join(path.read_text(encoding="utf-8") for path in page.glob("*.js"))
    words = {"three": "THREE.WebGLRenderer", "@sparkjsdev/spark": "SparkRenderer", "fflate": "invalid length/literal"}
    assert {("npm", name) for name, word in words.items() if word in scripts} == {
        (kind, name) for kind, name in listed if kind == "npm"
    }
    named = re.findall(rb"/([a-z_-]+)-\d+\.\d+\.\d+/src/", (page / "spark.wasm").read_bytes())
    assert {name.decode() for name in named} <= {name for kind, name in listed if kind == "cargo"}
    licences = (page / "licences.txt").read_text(encoding="utf-8")
    assert [name for _kind, name in listed if name not in licences] == []
    texts = sorted((REPOSITORY / "web" / "node_modules").glob("three/LICENSE"))
    assert all(path.read_text(encoding="utf-8").strip() in licences for path in texts)
