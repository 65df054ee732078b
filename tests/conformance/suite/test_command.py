"""`scarfmt conformance`: options, outputs, exit codes."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner, Result

from scarfmt.cli import cli
from tests.conformance.suite.conftest import FAKE, PATIENCE_SECONDS, SESSION, SuiteWriter, is_gone, wait_until

REPOSITORY = Path(__file__).resolve().parents[3]
DECODER = shlex.join([*FAKE, "{file}", "{k}", "{s}"])


def call(*arguments: object) -> Result:
    return CliRunner().invoke(cli, ["conformance", *map(str, arguments)])


@pytest.fixture
def folder(suite: SuiteWriter) -> Path:
    """Three vectors, one of which fails."""
    suite.decoded("valid/good", features=["one"])
    suite.decoded("valid/bad", {"answers": {}})
    suite.refused("invalid/good", features=["one", "two"])
    return suite.load().folder


@pytest.fixture
def run_(folder: Path, ask_by_session: bool) -> list[object]:
    """Arguments of a run over them, both ways."""
    way = ("--session", shlex.join(SESSION)) if ask_by_session else ("--decoder", DECODER)
    return ["run", "--suite", folder, *way]


def test_failures_are_exit_code_1_and_told_on_stderr(run_: list[object]) -> None:
    result = call(*run_)
    assert result.exit_code == 1
    assert [line.split() for line in result.stdout.splitlines()] == [
        ["class", "passed", "failed", "skipped"],
        ["valid", "1", "1", "0"],
        ["invalid", "1", "0", "0"],
        ["all", "2", "1", "0"],
        [],
        ["stage", "agrees", "differs"],
        ["values", "1", "0"],
    ]
    assert "FAILED valid/bad, layer 1: a file to be decoded is refused" in result.stderr
    assert "R-5.2-4 (SPEC.md §5.2)" in result.stderr
    assert "fake 1: 2 passed, 1 failed, 0 skipped" in result.stderr


def test_no_failure_is_exit_code_0_skips_or_not(run_: list[object], monkeypatch: pytest.MonkeyPatch) -> None:
    assert call(*run_, "--only", "*/good").exit_code == 0
    monkeypatch.setenv("FAKE_CLAIMS", json.dumps({"stages": ["container"]}))
    result = call(*run_)
    assert result.exit_code == 1, "nothing at all was asked"
    monkeypatch.setenv("FAKE_CLAIMS", json.dumps({"stages": ["models", "frequencies"]}))
    result = call(*run_)
    assert (result.exit_code, "skipped 2: nothing pinned" in result.stderr) == (0, True)


def test_json_alone_is_on_stdout(run_: list[object]) -> None:
    result = call(*run_, "--format", "json")
    value = json.loads(result.stdout)
    assert result.exit_code == 1
    assert [entry["id"] for entry in value["vectors"]] == ["valid/good", "valid/bad", "invalid/good"]


def test_a_report_is_written_whole_and_not_over_another(run_: list[object], tmp_path: Path) -> None:
    report = tmp_path / "out.xml"
    report.write_text("old")
    result = call(*run_, "--junit", report)
    assert (result.exit_code, "output-exists" in result.stderr, report.read_text()) == (2, True, "old")
    assert call(*run_, "--junit", report, "--force").exit_code == 1
    root = ElementTree.parse(report).getroot()
    failed = {case.get("name"): failure.get("message") for case in root for failure in case}
    assert (root.get("tests"), root.get("failures"), root.get("skipped")) == ("4", "1", "0")
    assert failed == {"valid/bad": "a file to be decoded is refused"}


def test_many_failures_are_counted_unless_verbose(suite: SuiteWriter) -> None:
    for number in range(23):
        suite.decoded(f"valid/v{number}", {"answers": {}})
    arguments = ["run", "--suite", suite.load().folder, "--session", shlex.join(SESSION)]
    short = call(*arguments).stderr
    assert (short.count("FAILED"), "3 more failures" in short) == (20, True)
    assert call(*arguments, "-v").stderr.count("FAILED") == 23


def test_a_decoder_that_says_nothing_of_itself_fails(folder: Path) -> None:
    """With a report all the same, for CI."""
    result = call("run", "--suite", folder, "--session", "cat", "--junit", folder / "out.xml")
    assert result.exit_code == 1
    assert "FAILED capabilities: the output is not an object with" in result.stderr
    assert ElementTree.parse(folder / "out.xml").getroot().get("failures") == "1"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["run", "--suite", "SUITE", "--decoder", "x {file}"], "{layers}, {stage}"),
        (["run", "--suite", "SUITE", "--decoder", "no-such-program {file} {k} {s}"], "no program 'no-such-program'"),
        (["run", "--suite", "SUITE", "--session", "'open"], "cannot be split"),
        (["run", "--suite", "SUITE", "--session", "cat", "--decoder", "cat {file} {k} {s}"], "exclude each other"),
        (["run", "--suite", "SUITE", "--session", "cat", "--stages", "models,stage"], "choose from container"),
        (["run", "--suite", "SUITE", "--session", "cat", "--only", "nothing"], "no vector"),
        (["run", "--suite", "SUITE", "--session", "cat", "--timeout", "0"], "--timeout"),
        (["run", "--suite", "SUITE", "--session", "cat", "--jobs", "0"], "--jobs"),
        (["run", "--suite", "SUITE/vectors", "--session", "cat"], "input-suite: no manifest.json"),
        (["list", "--suite", "SUITE", "--class", "none"], "no vector"),
    ],
)
def test_wrong_arguments_are_exit_code_2(folder: Path, arguments: list[str], said: str) -> None:
    result = call(*(argument.replace("SUITE", str(folder)) for argument in arguments))
    assert (result.exit_code, result.stdout) == (2, "")
    assert said in result.stderr


def test_vectors_are_listed(folder: Path) -> None:
    rows = [line.split() for line in call("list", "--suite", folder, "--feature", "one").stdout.splitlines()]
    assert [row[0] for row in rows] == ["id", "valid/good", "invalid/good"]
    assert rows[2][1:3] == ["refused", "explicit"]


def test_an_interrupt_ends_the_decoder_too(suite: SuiteWriter, tmp_path: Path) -> None:
    """An interrupt ends the decoder and leaves no half-written report."""
    told, report = tmp_path / "number", tmp_path / "report.xml"
    suite.decoded("valid/hang", {"misbehave": "hang", "told": str(told)})
    words = ["conformance", "run", "--suite", suite.load().folder, "--decoder", DECODER, "--junit", report]
    words += ["--timeout", 3600]
    # A test run in the background of a shell hands down that SIGINT is ignored.
    script = (
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler);"
        f"sys.argv[1:] = {[str(word) for word in words]!r}; from scarfmt.cli import main; main()"
    )
    code = (str(REPOSITORY), str(REPOSITORY / "conformance" / "suite"))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(code)}
    with subprocess.Popen(
        [sys.executable, "-c", script], env=environment, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert wait_until(lambda: told.exists() and bool(told.read_text()))
            process.send_signal(signal.SIGINT)
            _, errors = process.communicate(timeout=PATIENCE_SECONDS)
        finally:
            process.kill()
    assert process.returncode == 130
    assert "interrupted" in errors
    assert "Traceback" not in errors
    assert wait_until(lambda: is_gone(int(told.read_text())))
    assert not [path.name for path in tmp_path.iterdir() if "report" in path.name]
