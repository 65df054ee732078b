"""A commit as files of its own, so that nothing of the working tree gets into what is built."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
import tarfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
UMASK = 0o022
"""Archives keep the modes of files; those of two people should be the same."""
_STRANGE = ("PYTHONPATH", "PYTHONHOME", "CFLAGS", "CPPFLAGS", "CXXFLAGS", "LDFLAGS", "_PYTHON_HOST_PLATFORM")
"""Variables of the caller's environment that would get into the build."""


@dataclass(frozen=True)
class Tree:
    """The files of a commit.

    Attributes:
        folder: where they lie.
        epoch: when it was committed, in seconds since 1970: the time of everything in an archive.
    """

    folder: Path
    epoch: int

    def run(self, command: Sequence[str | Path], inside: str = ".") -> None:
        """Run a command in a folder of the tree; what it prints is shown if it fails.

        Raises:
            subprocess.CalledProcessError: it failed.
        """
        kept = {name: value for name, value in os.environ.items() if name not in _STRANGE}
        same = {"SOURCE_DATE_EPOCH": str(self.epoch), "LC_ALL": "C.UTF-8", "TZ": "UTC", "PYTHONHASHSEED": "0"}
        done = subprocess.run(
            command, cwd=self.folder / inside, env=kept | same, umask=UMASK, check=False, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        if done.returncode != 0:
            print(done.stdout, file=sys.stderr)
            done.check_returncode()

    def version(self) -> str:
        """The version, which `scarfmt/__init__.py` says.

        Raises:
            ValueError: it is not three numbers, which is all that Python's and npm's rules have in common.
        """
        module = ast.parse((self.folder / "scarfmt" / "__init__.py").read_text(encoding="utf-8"))
        for statement in module.body:
            match statement:
                case ast.Assign(targets=[ast.Name(id="__version__")], value=ast.Constant(value=str(version))):
                    if re.fullmatch(r"\d+\.\d+\.\d+", version):
                        return version
        raise ValueError("scarfmt/__init__.py has no __version__ of three numbers")


def export(commit: str, folder: Path) -> Tree:
    """The files of a commit, written below a new folder.

    Raises:
        subprocess.CalledProcessError: this is no repository, or has no such commit.
        FileExistsError: there is such a folder.
    """
    folder.mkdir(parents=True)
    packed = folder.with_name(f"{folder.name}.tar")
    _git("archive", "--format=tar", f"--output={packed}", commit)
    with tarfile.open(packed) as archive:
        archive.extractall(folder, filter="data")  # which takes the right to write from all but the owner
    packed.unlink()
    return Tree(folder, int(_git("log", "-1", "--format=%ct", commit)))


def list_uncommitted() -> list[str]:
    """Names of tracked files that differ from the last commit."""
    return [line[3:] for line in _git("status", "--porcelain", "--untracked-files=no").splitlines()]


def _git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=REPOSITORY, check=True, capture_output=True, text=True).stdout

