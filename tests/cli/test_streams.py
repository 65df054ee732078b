"""Names, pipes, URLs and standard streams of every kind: what can be read is read, what cannot be is one clear line."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.cli.conftest import REPOSITORY, run

pytestmark = pytest.mark.skipif(os.name != "posix", reason="POSIX streams and names")

Feed = Callable[[Path], Path]


@pytest.fixture
def feed(tmp_path: Path) -> Iterator[Feed]:
    """A pipe through which a file comes once, as from `<(cat FILE)`."""
    writers = []

    def open_pipe(path: Path) -> Path:
        pipe = tmp_path / f"pipe{len(writers)}"
        os.mkfifo(pipe)
        writers.append(threading.Thread(target=lambda: pipe.write_bytes(path.read_bytes()), daemon=True))
        writers[-1].start()
        return pipe

    yield open_pipe
    for writer in writers:
        writer.join(5)


def sh(script: str, cwd: Path, **env: str) -> subprocess.CompletedProcess[bytes]:
    """Run a shell script in which `$S` is the command."""
    command = f"S='{sys.executable} -m scarfmt'; {script}"
    env = {**os.environ, "PYTHONPATH": str(REPOSITORY), **env}
    return subprocess.run(["bash", "-c", command], cwd=cwd, capture_output=True, env=env, check=False, timeout=120)


def test_a_pipe_is_inspected_validated_decoded_and_truncated(feed: Feed, explicit_scar: Path, tmp_path: Path) -> None:
    for command in ("inspect", "validate"):
        assert run(command, feed(explicit_scar)).exit_code == 0
    for name, arguments in (("decode", ("a.npz",)), ("truncate", ("a.scar", "--layers", 2))):
        target = tmp_path / str(arguments[0])
        assert run(name, feed(explicit_scar), target, *arguments[1:]).exit_code == 0
        expected = target.read_bytes()
        assert run(name, explicit_scar, target, *arguments[1:], "--force").exit_code == 0
        assert target.read_bytes() == expected


def test_pipes_are_compared_also_layer_by_layer(feed: Feed, ply: Path, encoded: Path) -> None:
    """The layers of one pipe are all read from what came through it once."""
    view = ("--views", 1, "--size", "32x24", "--json", "--no-ssim")
    result = run("compare", feed(ply), feed(encoded), *view, "--all-layers")
    assert result.exit_code == 0, result.stderr
    expected = json.loads(run("compare", ply, encoded, *view, "--all-layers").stdout)
    assert json.loads(result.stdout)["layers"] == expected["layers"]


def test_shells_pass_pipes_as_names(explicit_scar: Path, tmp_path: Path) -> None:
    for script in (f"$S inspect <(cat {explicit_scar})", f"cat {explicit_scar} | $S inspect /dev/stdin"):
        done = sh(script, tmp_path)
        assert (done.returncode, done.stderr) == (0, b"")
        assert done.stdout.startswith(b"format ")


@pytest.mark.parametrize(
    ("script", "refusal"),
    [
        ("$S decode FILE - >&-", "output-stream: standard output is closed"),
        ("$S inspect FILE >&-", "output-stream: standard output is closed"),
        ("$S compare FILE FILE >&-", "output-stream: standard output is closed"),
        ("$S inspect FILE --json >&-", "output-stream: standard output is closed"),
        ("$S validate FILE --json >&-", "output-stream: standard output is closed"),
        ("$S decode - out.ply <&-", "input-stream: standard input is closed"),
        ("$S encode - out.scar <&-", "input-stream: standard input is closed"),
    ],
)
def test_a_closed_stream_is_one_line_and_exit_code_2(
    explicit_scar: Path, tmp_path: Path, script: str, refusal: str
) -> None:
    done = sh(script.replace("FILE", str(explicit_scar)), tmp_path)
    assert done.returncode == 2
    assert done.stderr.decode().startswith(f"scarfmt: error: {refusal}")
    assert done.stderr.count(b"\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_closed_standard_error_is_none(explicit_scar: Path, tmp_path: Path) -> None:
    assert sh(f"$S validate {explicit_scar} 2>&-", tmp_path).returncode == 0
    assert sh("$S validate nothing.scar 2>&-", tmp_path).returncode == 1


def test_names_that_are_not_utf_8_go_into_json_and_text(explicit_scar: Path, tmp_path: Path) -> None:
    """Such names are written with the escapes that Python uses for them; the document stays UTF-8."""
    name = b"na\xffme.scar"
    (tmp_path / os.fsdecode(name)).write_bytes(explicit_scar.read_bytes())
    strict = {"PYTHONIOENCODING": "utf-8:strict"}
    done = sh("$S validate na$'\\xff'me.scar --json", tmp_path, **strict)
    assert done.returncode == 0, done.stderr
    assert os.fsencode(json.loads(done.stdout.decode("utf-8"))["file"]) == name
    assert sh("$S validate na$'\\xff'me.scar", tmp_path, **strict).returncode == 0


def test_json_is_ascii_on_a_stream_that_is_not_utf_8(explicit_scar: Path, tmp_path: Path) -> None:
    (tmp_path / "木.scar").write_bytes(explicit_scar.read_bytes())
    done = sh("$S validate 木.scar --json", tmp_path, PYTHONIOENCODING="ascii")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.decode("ascii"))["file"] == "木.scar"


def test_nohup_stays_in_force(tmp_path: Path) -> None:
    """A hang-up that the caller ignores is not made to end the command."""
    script = "import signal as s, scarfmt.cli as c; c._end_cleanly_on_signals(); print(+s.getsignal(s.SIGHUP))"
    done = sh(f"trap '' HUP; {sys.executable} -c '{script}'", tmp_path)
    assert done.stdout == b"%d\n" % signal.SIG_IGN


@contextmanager
def silent_server() -> Iterator[str]:
    """The URL of a server that accepts and never answers."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield f"http://127.0.0.1:{server.getsockname()[1]}/x.scar"


@pytest.mark.parametrize(
    "command", [("inspect",), ("validate",), ("decode", "out.ply"), ("truncate", "out.scar", "--layers", 1)]
)
def test_a_silent_server_is_left_after_the_time_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: tuple[object, ...]
) -> None:
    pytest.importorskip("aiohttp", reason="URLs need the extra http")
    monkeypatch.chdir(tmp_path)
    start = time.monotonic()
    with silent_server() as url:
        # 64 KiB, the first request, have 16 seconds of their own at the slowest rate; inspect asks for 4.
        monkeypatch.setattr("scarfmt.container.source.SLOWEST_BYTES_PER_SECOND", 1 << 20)
        result = run(command[0], url, *command[1:], "--timeout", 0.3)
    assert result.exit_code == 1
    assert "input-source: cannot open http://127.0.0.1" in result.stderr
    assert "no complete answer in time (--timeout gives it more)" in result.stderr
    assert time.monotonic() - start < 30  # a hang, not a slow machine, is what this tells apart
    assert list(tmp_path.iterdir()) == []
