"""Every decoder of this repository passes the whole suite, asked as a third party's would be."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import conformance

SUITE = Path(conformance.__file__).parent
REFERENCE = f"{sys.executable} -m scarfmt_conformance.reference.answers"
JAVASCRIPT = f"node {SUITE / 'decoders' / 'js' / 'cli.js'}"
QUESTION = "{file} --layers {layers} --stage {stage}"
needs_node = pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed: no JavaScript decoder")


def _score(*arguments):
    """The report of a run of the suite."""
    command = [sys.executable, "-m", "scarfmt", "conformance", "run", "--format", "json", "--suite", str(SUITE)]
    run = subprocess.run([*command, *arguments], capture_output=True, text=True, timeout=900, check=False)
    assert run.stdout, run.stderr
    return json.loads(run.stdout), run


def _check_all_pass(report, run, least):
    failed = [row["id"] for row in report["vectors"] if row["outcome"] == "failed"]
    assert not failed, f"{failed[:20]}\n{run.stderr[-2000:]}"
    assert run.returncode == 0
    passed = sum(row["outcome"] == "passed" for row in report["vectors"])
    assert passed == len(report["vectors"]) >= least


@pytest.mark.parametrize(
    "options",
    ["--access whole", "--access range", "--backend torch"],
    ids=["numpy-whole", "numpy-by-range", "torch"],
)
def test_the_reference_decoder_passes_every_vector(options):
    report, run = _score("--session", f"{REFERENCE} --session {options}", "--memory", "4096")
    _check_all_pass(report, run, 150)


@needs_node
def test_the_javascript_decoder_passes_every_vector():
    report, run = _score("--session", f"{JAVASCRIPT} --session")
    _check_all_pass(report, run, 150)


@pytest.mark.parametrize(
    "command", [REFERENCE, pytest.param(JAVASCRIPT, marks=needs_node)], ids=["reference", "javascript"]
)
def test_one_process_a_question_gives_the_same(command):
    report, run = _score("--decoder", f"{command} {QUESTION}", "--only", "valid/index-*", "--last-layer")
    _check_all_pass(report, run, 5)


def test_the_suite_notices_a_decoder_that_drops_a_bit(tmp_path):
    """One changed bit of one array: the vectors with that array fail, and the stage is named."""
    wrong = tmp_path / "wrong.py"
    wrong.write_text(
        "import sys\n"
        "from scarfmt_conformance.reference import answers\n"
        "hashed = answers.hashed\n"
        "answers.hashed = lambda arrays: hashed(\n"
        "    {name: array ^ 1 if name == 'v.OPACITY' else array for name, array in arrays.items()})\n"
        "answers.main(sys.argv[1:])\n"
    )
    report, run = _score("--session", f"{sys.executable} {wrong} --session", "--only", "valid/explicit-refined")
    assert run.returncode == 1
    (row,) = report["vectors"]
    assert row["outcome"] == "failed"
    assert "v.OPACITY" in json.dumps(row)
