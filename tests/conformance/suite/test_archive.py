"""The suite as one file: what the wheel of scarfmt-conformance carries."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import pytest
from click.testing import CliRunner
from scarfmt_conformance.archive import members, names, pack
from scarfmt_conformance.manifest import check_file, find_suite, load_expectation, open_suite

from scarfmt.cli import cli
from scarfmt.errors import InvalidInput

CONFORMANCE = Path(__file__).resolve().parents[3] / "conformance"


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The suite of this checkout."""
    path = tmp_path_factory.mktemp("archive") / "vectors.zip"
    pack(CONFORMANCE, path)
    return path


def test_it_holds_every_vector_as_the_manifest_names_it(archive: Path) -> None:
    """A file left out or changed would be a damaged suite."""
    with open_suite(archive) as suite:
        assert [vector.id for vector in suite.vectors] == names()
        for vector in suite.vectors:
            check_file(vector)
            load_expectation(vector)
        files = {path.relative_to(suite.folder).as_posix() for path in suite.folder.rglob("vectors/**/*.*")}
    assert files == set(members(CONFORMANCE))
    assert not suite.folder.exists(), "what was unpacked is removed"


def test_equal_vectors_make_equal_archives(archive: Path, tmp_path: Path) -> None:
    """A wheel built twice is the same wheel."""
    pack(CONFORMANCE, tmp_path / "again.zip")
    assert (tmp_path / "again.zip").read_bytes() == archive.read_bytes()


def test_a_damaged_archive_is_a_fault_of_the_suite(archive: Path, tmp_path: Path) -> None:
    """A damaged archive must not count as a failure of the decoder."""
    (tmp_path / "cut.zip").write_bytes(archive.read_bytes()[:100_000])
    with pytest.raises(InvalidInput, match="input-suite"):
        find_suite(str(tmp_path / "cut.zip"))
    with pytest.raises(InvalidInput, match="input-suite"), open_suite(tmp_path / "cut.zip"):
        pass
    with zipfile.ZipFile(tmp_path / "other.zip", "w") as other:
        other.writestr("readme.txt", "something else")
    with pytest.raises(InvalidInput, match="input-suite"), open_suite(find_suite(str(tmp_path / "other.zip"))):
        pass


def test_commands_take_an_archive(archive: Path, tmp_path: Path) -> None:
    """`list`, `run` with its report, and `unpack`, which writes a folder that the others take."""

    def call(*arguments: object) -> str:
        result = CliRunner().invoke(cli, ["conformance", *map(str, arguments)])
        assert result.exit_code == 0, result.stderr
        return result.stdout

    listed = call("list", "--suite", archive, "--class", "either")
    call("unpack", "--suite", archive, tmp_path / "folder")
    assert call("list", "--suite", tmp_path / "folder", "--class", "either") == listed
    report = json.loads(call("run", "--suite", archive, "--only", "worked", "--session", "--format", "json"))
    assert report["counts"]["passed"] == 1
    again = CliRunner().invoke(cli, ["conformance", "unpack", str(tmp_path / "folder")])
    assert (again.exit_code, "output-exists" in again.stderr) == (2, True)
