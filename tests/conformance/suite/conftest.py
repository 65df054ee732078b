"""Small suites whose files contain the answers of the fake decoder, and runs over them."""

from __future__ import annotations

import hashlib
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from scarfmt_conformance.manifest import Suite, load_suite
from scarfmt_conformance.process import Limits, Program
from scarfmt_conformance.runner import Options, Result, Run, run

FAKE = [sys.executable, "-I", "-S", str(Path(__file__).with_name("fake_decoder.py"))]
ONE_SHOT, SESSION = [*FAKE, "{file}", "{layers}", "{stage}"], [*FAKE, "--session"]
MIB = 1 << 20
PATIENCE_SECONDS = 60.0
BRIEF_SECONDS = 3.0
"""Time limit where it is to be met: enough for the fake decoder to start on a busy machine."""

Json = dict[str, Any]


def array(sha256: str = "ab" * 32, dtype: str = "<i4", shape: tuple[int, ...] = (2, 3), **more: Any) -> Json:
    """An exact array, of ``expect.json`` or of an answer."""
    return {"dtype": dtype, "shape": list(shape), "sha256": sha256, **more}


def stages(**arrays: Json) -> Json:
    """A stage ``values`` with those arrays."""
    return {"values": {"arrays": arrays}}


class SuiteWriter:
    """A suite in a folder, vector by vector."""

    def __init__(self, folder: Path):
        self.folder = folder
        self._entries: list[Json] = []

    def add(self, id_: str, plan: Json, *, profile: str | None = "explicit", **expect: Any) -> Path:
        """Add a vector; its file holds `plan`. Returns its folder."""
        folder = self.folder / "vectors" / id_
        folder.mkdir(parents=True)
        data = json.dumps(plan).encode()
        (folder / "input.scar").write_bytes(data)
        class_ = id_.partition("/")[0] if "/" in id_ else "valid"
        common = {"id": id_, "class": class_, "profile": profile, "rules": ["R-5.2-4", "R-11-1"], "features": []}
        expect = {"format": "scar-conformance 2", **common, "purpose": f"purpose of {id_}", **expect}
        (folder / "expect.json").write_text(json.dumps(expect))
        place = f"vectors/{id_}"
        entry = {"file": f"{place}/input.scar", "expect": f"{place}/expect.json", "bytes": len(data), **common}
        sha256 = hashlib.sha256(data).hexdigest()
        self._entries.append({**entry, "sha256": sha256, "features": expect["features"], "result": expect["result"]})
        return folder

    def decoded(self, id_: str, plan: Json | None = None, **expect: Any) -> Path:
        """Add a vector of one layer; the decoder answers it right, but for what `plan` says."""
        right = stages(position=array())
        layers = [{"layer": 1, "anchors": 2, "stages": right}]
        plan = {"answers": {"all 1": {"stages": right}}, **(plan or {})}
        return self.add(id_, plan, **{"result": "decoded", "layers": layers, **expect})

    def refused(self, id_: str, plan: Json | None = None, **expect: Any) -> Path:
        """Add a vector to be refused as ``bad-table``; the decoder does, but for what `plan` says."""
        plan = {"answers": {"all 0": {"refused": "bad-table", "offset": 7, "message": "no"}}, **(plan or {})}
        return self.add(id_, plan, **{"result": "refused", "refusal": "bad-table", "stage": "tiles", **expect})

    def load(self) -> Suite:
        """Write the manifest, and read the suite."""
        manifest = {"format": "scar-conformance 2", "bitstream": "0.1", "licence": "CC0-1.0", "vectors": self._entries}
        (self.folder / "manifest.json").write_text(json.dumps(manifest))
        return load_suite(self.folder)


@pytest.fixture
def suite(tmp_path: Path) -> SuiteWriter:
    return SuiteWriter(tmp_path)


@pytest.fixture(params=["one process a question", "session"])
def ask_by_session(request: pytest.FixtureRequest) -> bool:
    return bool(request.param == "session")


def score(
    suite: SuiteWriter, session: bool = False, options: Options | None = None, limits: Limits | None = None
) -> Run:
    """Ask the fake decoder about every vector."""
    loaded = suite.load()
    return run(loaded, loaded.vectors, lambda: program(session, limits), options or Options())


def program(session: bool, limits: Limits | None = None) -> Program:
    """The fake decoder, to be asked in one of the two ways."""
    return Program(SESSION if session else ONE_SHOT, limits or Limits(PATIENCE_SECONDS), session)


def only(results: Run) -> Result:
    """The result of the only vector."""
    (result,) = results.results
    return result


def is_gone(number: int) -> bool:
    """Whether a process has ended, reaped or not."""
    try:
        state = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return True
    return state in "ZX"


def wait_until(holds: Callable[[], bool]) -> bool:
    """Whether something holds soon: within seconds, on however busy a machine."""
    end = time.monotonic() + PATIENCE_SECONDS
    while not holds():
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True
