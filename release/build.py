"""``make dist``: everything of a release, from a commit, into a folder that does not exist yet.

The same commit gives the same bytes, whatever the folder and the time (docs/under-the-hood.md says how).
"""

from __future__ import annotations

import argparse
import hashlib
import platform
import sys
import tempfile
from pathlib import Path

from release.archives import settle_tar
from release.bom import write_bill
from release.npm import build_web, pack_npm
from release.tree import Tree, export, list_uncommitted
from release.vectors import write_vectors

SUMS = "SHA256SUMS"
_MANYLINUX = "manylinux_2_29_x86_64"
"""Tag of wheels for any Python, and for glibc 2.29 or newer, whose logarithms the trainer uses."""


def build(commit: str, out: Path) -> None:
    """Build a release of a commit.

    Args:
        out: a folder that is made.

    Raises:
        FileExistsError: it is there.
        subprocess.CalledProcessError: a step failed.
    """
    out.mkdir(parents=True)
    out = out.resolve()
    with tempfile.TemporaryDirectory(prefix="scarfmt-release-") as place:
        tree = export(commit, Path(place) / "tree")
        tools = Path(place) / "tools"
        _install_tools(tree, tools)
        build_web(tree, tools)
        _build_python(tree, tools, out)
        write_vectors(tree, out)
        pack_npm(tree, out)
        write_bill(tree, out)
    sums = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(out.iterdir())}
    (out / SUMS).write_text("".join(f"{value}  {name}\n" for name, value in sums.items()), encoding="utf-8")


def _install_tools(tree: Tree, tools: Path) -> None:
    """An environment with the pinned tools that build the parts."""
    tree.run([sys.executable, "-m", "venv", tools])
    pip: list[str | Path] = [tools / "bin" / "python", "-m", "pip", "--quiet", "--disable-pip-version-check"]
    pins = [tree.folder / folder / "requirements.txt" for folder in ("release", "web")]
    tree.run([*pip, "install", "-r", pins[0], "-r", pins[1]])


def _build_python(tree: Tree, tools: Path, out: Path) -> None:
    """The sdist, then the wheels of package and suite."""
    command: list[str | Path] = [tools / "bin" / "python", "-m", "build", "--no-isolation", "--outdir", out]
    tree.run([*command, "--sdist", "."])
    settle_tar(out / f"scarfmt-{tree.version()}.tar.gz", tree.epoch)
    on_linux = (platform.system(), platform.machine()) == ("Linux", "x86_64")
    named = [f"-C--build-option=--plat-name={_MANYLINUX}"] if on_linux else []
    tree.run([*command, "--wheel", *named, "."])
    tree.run([*command, "--wheel", "conformance/suite"])


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder, which is made")
    parser.add_argument("--commit", default="HEAD", help="what to release [default: HEAD]")
    arguments = parser.parse_args()
    if arguments.out.exists():
        parser.error(f"{arguments.out} exists: remove it, or name another folder")
    if arguments.commit == "HEAD" and (changed := list_uncommitted()):
        print(f"not in the release, because not committed: {', '.join(changed)}", file=sys.stderr)
    build(arguments.commit, arguments.out)
    print((arguments.out / SUMS).read_text(encoding="utf-8"), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
