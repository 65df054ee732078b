"""Check of a wheel: it holds its packages and nothing else, and a library that old Linuxes can load."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

PACKAGES = {
    "scarfmt": {"scarfmt", "reference_decoder", "reference_encoder"},
    "scarfmt_conformance": {"scarfmt_conformance"},
}
"""Top-level packages by distribution."""
MOST_BYTES = {"scarfmt": 3_000_000, "scarfmt_conformance": 5_000_000}
STRANGERS = ("/tests/", "/testing/", "/benchmarks/", "/fuzz/", ".c", ".h", ".pyc")
"""Parts of names that have no business in a wheel."""
GLIBC = (2, 29)
"""Version of glibc in manylinux_2_29, the tag in the name of the wheel."""
LIBC = {"libc.so.6", "libm.so.6", "ld-linux-x86-64.so.2"}
LIBRARIES = {"scarfmt/native/native.so", "scarfmt/render/native/native.so"}


def check(path: Path) -> list[str]:
    """The faults of a wheel; empty if there are none."""
    distribution = path.name.partition("-")[0]
    wrong = []
    with zipfile.ZipFile(path) as wheel:
        names = [name for name in wheel.namelist() if ".dist-info/" not in name]
        found = {name.partition("/")[0] for name in names}
        if found != PACKAGES[distribution]:
            wrong.append(f"top-level packages {sorted(found)}, not {sorted(PACKAGES[distribution])}")
        wrong += [f"{name} does not belong there" for name in names if _strange(name)]
        wrong += [f"no py.typed in {name}" for name in found if f"{name}/py.typed" not in names]
        page = {f"scarfmt/viewer/page/{name}" for name in ("index.html", "scar.wasm")}
        if distribution == "scarfmt" and not page <= set(names):
            wrong.append("the viewer page is missing: make web")
        libraries = [name for name in names if name.endswith(".so")]
        if distribution == "scarfmt" and set(libraries) != LIBRARIES:
            wrong.append(f"libraries {libraries}: not those of decoder and renderer")
        for name in libraries:
            wrong += _check_library(wheel.read(name))
    if path.stat().st_size > MOST_BYTES[distribution]:
        wrong.append(f"{path.stat().st_size:,} bytes, more than {MOST_BYTES[distribution]:,}")
    if libraries and "-py3-none-" not in path.name:
        wrong.append("the name binds it to one Python, the kernel does not")
    return wrong


def _strange(name: str) -> bool:
    return any(part in name if part.startswith("/") else name.endswith(part) for part in STRANGERS)


def _check_library(data: bytes) -> list[str]:
    """Symbols newer than the name of the wheel says, libraries beyond libc, and what a debugger needs."""
    with tempfile.NamedTemporaryFile(suffix=".so") as file:
        file.write(data)
        file.flush()
        command = ["objdump", "-T", "-p", "-h", file.name]
        shown = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    versions = {tuple(map(int, found.split("."))) for found in re.findall(r"GLIBC_([\d.]+)", shown)}
    needed = set(re.findall(r"NEEDED\s+(\S+)", shown))
    wrong = [f"needs GLIBC {version}" for version in versions if version > GLIBC]
    wrong += [f"needs {name}" for name in needed - LIBC]
    if ".debug_info" in shown:
        wrong.append("holds debug information")
    return wrong


def main() -> int:
    """1 if something is wrong with a wheel."""
    bad = False
    for name in sys.argv[1:]:
        path = Path(name)
        wrong = check(path)
        print(f"{path.name}: {path.stat().st_size:,} bytes, {'; '.join(wrong) or 'as it should be'}")
        bad |= bool(wrong)
    return bad


if __name__ == "__main__":
    sys.exit(main())
