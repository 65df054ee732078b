"""Two encodings never work in one directory, and one that was ended leaves it free."""

from __future__ import annotations

import json
import multiprocessing
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from reference_encoder.scale.claim import NAME, claimed
from reference_encoder.scale.work import Work
from scarfmt.errors import InvalidInput

PLACES = ["{}/work", "memory://{}/work"]
HOLDER = """
import sys, time
from reference_encoder.scale.claim import claimed
from reference_encoder.scale.work import Work
with claimed(Work(sys.argv[1])):
    print("held", flush=True)
    time.sleep(600)
"""


def _refused(work: Work) -> str:
    with pytest.raises(InvalidInput) as caught, claimed(work):
        pass
    assert caught.value.refusal == "work-in-use"
    return str(caught.value)


@pytest.mark.parametrize("place", PLACES)
def test_a_directory_in_use_is_refused_and_afterwards_free(tmp_path: Path, place: str) -> None:
    work = Work(place.format(tmp_path))
    with claimed(work):
        message = _refused(work)
        assert str(os.getpid()) in message
        assert "--work" in message
    for _ in range(2):
        with claimed(work):
            pass


@pytest.mark.parametrize("place", PLACES)
def test_a_directory_is_free_after_an_error(tmp_path: Path, place: str) -> None:
    work = Work(place.format(tmp_path))
    with pytest.raises(RuntimeError), claimed(work):
        raise RuntimeError
    with claimed(work):
        pass


def test_what_a_killed_process_held_is_taken_over(tmp_path: Path) -> None:
    """Its file still names it."""
    command = [sys.executable, "-c", HOLDER, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        assert f"process {holder.pid} of {socket.gethostname()}" in _refused(Work(str(tmp_path)))
        holder.kill()
        holder.wait()
    assert json.loads((tmp_path / NAME).read_text())["process"] == holder.pid
    with claimed(Work(str(tmp_path))):
        assert json.loads((tmp_path / NAME).read_text())["process"] == os.getpid()


@pytest.mark.skipif(sys.platform != "linux", reason="beginnings of processes are looked up in /proc")
@pytest.mark.parametrize(("began", "stale"), [("a time that has gone", True), (None, False)])
def test_at_a_url_a_process_is_looked_up_where_it_can_be(tmp_path: Path, began: str | None, stale: bool) -> None:
    """A number that was given again is another process; of a system without beginnings nothing is known."""
    work = Work(f"memory://{tmp_path}/work")
    said = {"host": socket.gethostname(), "process": multiprocessing.current_process().pid, "began": began}
    with work.write(NAME) as file:
        file.write(json.dumps(said).encode())
    if stale:
        with claimed(work):
            pass
    else:
        assert "remove" in _refused(work)


@pytest.mark.parametrize("said", [b"", b"{", b"[]", b'{"host": "elsewhere", "process": 1, "began": "x 1"}'])
def test_at_a_url_what_cannot_be_known_is_left_to_people(tmp_path: Path, said: bytes) -> None:
    """A file that was cut short, and a process of another machine."""
    work = Work(f"memory://{tmp_path}/work")
    with work.write(NAME) as file:
        file.write(said)
    assert f"remove {work.path(NAME)}" in _refused(work)
