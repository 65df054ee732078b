"""`make dist-test`: a release is the same bytes when it is built again, and each part works where nothing else is.

Needs PyPI, npm, Node, and compilers for C and WebAssembly; half an hour on two slow cores.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from pathlib import Path

import pytest
from scarfmt_conformance.archive import expectation, read

from release.archives import contents
from release.build import build
from release.compare import differences
from release.first_hour import PAGES, try_page
from scarfmt import __version__
from tests.conftest import REPOSITORY
from tests.release.conftest import environment, run

pytestmark = pytest.mark.release
VALIDATE = """
import pathlib, sys
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator
sys.exit(JsonStrictValidator(SchemaVersion.V1_6).validate_str(pathlib.Path(sys.argv[1]).read_text()))
"""
"""Ends with status 0 where nothing is wrong."""
IN_NODE = Path(__file__).with_name("decode_in_node.mjs")
SCENE = "valid/pages"


def _wheel(dist: Path) -> Path:
    (found,) = dist.glob("scarfmt-*.whl")
    return found


def test_a_release_has_these_parts(dist: Path) -> None:
    named = {path.name.replace(__version__, "V") for path in dist.iterdir()}
    assert {name for name in named if not name.endswith(".whl")} == {
        "scarfmt-V.tar.gz", "scar-stream-V.tgz", "scar-vectors-V.zip", "scarfmt-V.cdx.json", "SHA256SUMS",
    }  # fmt: skip
    assert len(list(dist.glob("*.whl"))) == 2


def test_another_build_in_another_folder_gives_the_same_bytes(
    dist: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The time is another too; so are time zone, language, hash seed and the modes that new files get."""
    place = tmp_path / "a folder with a longer name"
    place.mkdir()
    for name, value in {"TMPDIR": str(place), "TZ": "Asia/Tokyo", "LC_ALL": "C", "PYTHONHASHSEED": "7"}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr("tempfile.tempdir", None)
    old = os.umask(0o077)
    try:
        build("HEAD", tmp_path / "again")
    finally:
        os.umask(old)
    assert differences(dist, tmp_path / "again") == []


def test_wheels_hold_what_belongs_there_and_nothing_else(dist: Path) -> None:
    run([sys.executable, ".ci/check_wheel.py", *sorted(dist.glob("*.whl"))])


def test_the_wheel_encodes_inspects_truncates_decodes_and_serves_the_page(
    dist: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHON", sys.executable)
    run([".ci/try_wheel", dist])


@pytest.mark.parametrize("page", PAGES)
def test_printed_commands_work_where_nothing_is_installed(page: str, tmp_path: Path) -> None:
    assert try_page(page, tmp_path) == 0


def test_the_sdist_builds_a_wheel_of_the_same_files(dist: Path, tmp_path: Path) -> None:
    """All of it but the tag of the platform, which who builds for others names himself."""
    source = dist / f"scarfmt-{__version__}.tar.gz"
    tools = environment(tmp_path / "tools", "-r", REPOSITORY / "release" / "requirements.txt")
    run([tools / "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "-w", tmp_path, source], tmp_path)
    built, released = contents(_wheel(tmp_path)), contents(_wheel(dist))
    of_platform = {name for name in released if name.endswith((".dist-info/WHEEL", ".dist-info/RECORD"))}
    assert built.keys() == released.keys()
    assert [name for name in built if built[name] != released[name] and name not in of_platform] == []


def test_the_npm_package_decodes_in_node(dist: Path, tmp_path: Path) -> None:
    """In an empty folder."""
    shutil.copy(IN_NODE, tmp_path)
    (tmp_path / "package.json").write_text('{"private": true}')
    package = dist / f"scar-stream-{__version__}.tgz"
    run(["npm", "install", "--silent", "--no-audit", "--no-fund", "--omit=peer", package], tmp_path)
    assert [path.name for path in (tmp_path / "node_modules").iterdir() if path.name[0] != "."] == ["scar-stream"]
    (tmp_path / "input.scar").write_bytes(read(SCENE))
    last = expectation(SCENE)["layers"][-1]
    (count, *_rest) = last["stages"]["values"]["arrays"]["position"]["shape"]
    assert int(run(["node", IN_NODE.name, tmp_path / "input.scar"], tmp_path)) == count


def test_the_vectors_score_the_reference_decoder(dist: Path, tmp_path: Path) -> None:
    tools = environment(tmp_path / "tools", _wheel(dist), next(dist.glob("scarfmt_conformance-*.whl")))
    vectors = dist / f"scar-vectors-{__version__}.zip"
    shutil.unpack_archive(vectors, tmp_path / "vectors")
    assert {"README.md", "PROTOCOL.md", "SPEC.md", "LICENSE", "LICENSE-CC0"} <= {
        path.name for path in (tmp_path / "vectors").iterdir()
    }
    command: list[str | Path] = [tools / "scarfmt", "conformance", "run", "--suite", tmp_path / "vectors"]
    report = json.loads(run([*command, "--session", "--last-layer", "--format", "json"], tmp_path))
    listed = json.loads((tmp_path / "vectors" / "manifest.json").read_text())["vectors"]
    assert report["passed"]
    assert len(report["vectors"]) == len(listed)


def test_judges_from_outside_accept_bill_and_citation(dist: Path, tmp_path: Path) -> None:
    """CycloneDX's own library checks the bill, cffconvert the citation."""
    bill = environment(tmp_path / "bill", "cyclonedx-python-lib[json-validation]==11.12.0")
    run([bill / "python", "-c", VALIDATE, dist / f"scarfmt-{__version__}.cdx.json"])
    citation = environment(tmp_path / "citation", "cffconvert==2.0.0")
    run([citation / "cffconvert", "--validate", "--infile", REPOSITORY / "CITATION.cff"])
