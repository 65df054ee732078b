"""Debian systems of other processors, unpacked below a folder and run by qemu in user mode.

Nothing is installed: a private apt, whose state lies below the folder too, downloads packages, which are only unpacked.
Needed on this machine: apt, dpkg-deb, ``qemu-user`` and the cross compilers named in `MACHINES`.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
STANDIN = Path(__file__).resolve().parent / "standin"

SUITE = "trixie"
MIRROR = os.environ.get("DEBIAN_MIRROR", "http://deb.debian.org/debian")
KEYRING = "/usr/share/keyrings/debian-archive-keyring.gpg"
PACKAGES = ("python3", "python3-numpy", "python3-construct", "python3-click", "python3-fsspec")
COPIED = ("scarfmt", "reference_decoder", "conformance/suite/scarfmt_conformance")
NATIVE_FLAGS = ("-O3", "-fno-trapping-math", "-fno-math-errno", "-fPIC", "-shared")

_APT = """\
Dir "{folder}";
Dir::State "{folder}/state";
Dir::State::status "{folder}/status";
Dir::Cache "{folder}/cache";
Dir::Etc::sourcelist "{folder}/sources.list";
Dir::Etc::sourceparts "-";
Dir::Etc::preferencesparts "-";
APT::Architecture "{debian}";
APT::Architectures {{ "{debian}"; }};
APT::Install-Recommends "false";
APT::Sandbox::User "root";
Acquire::Languages "none";
"""


class Unavailable(Exception):
    """This machine cannot emulate another; the message names what is missing."""


@dataclass(frozen=True)
class Machine:
    """A processor.

    Attributes:
        name: architecture of Debian's packages.
        triplet: of its compiler, and of the folder of its libraries.
        byteorder: ``little`` or ``big``, as Python names it.
        qemu: the emulator and its options.
    """

    name: str
    triplet: str
    byteorder: str
    qemu: tuple[str, ...]

    @property
    def compiler(self) -> str:
        """The cross compiler."""
        return f"{self.triplet}-gcc"


MACHINES = (
    Machine("s390x", "s390x-linux-gnu", "big", ("qemu-s390x",)),
    # Pointer authentication of the default processor takes minutes where this one takes seconds.
    Machine("arm64", "aarch64-linux-gnu", "little", ("qemu-aarch64", "-cpu", "cortex-a72")),
)


@dataclass(frozen=True)
class System:
    """An unpacked system.

    Attributes:
        machine: its processor.
        folder: where all of it lies.
        native: whether the C library is used.
    """

    machine: Machine
    folder: Path
    native: bool = True

    @property
    def root(self) -> Path:
        """The root of its file system."""
        return self.folder / "root"

    def command(self, *arguments: str) -> list[str]:
        """The command that runs Python in it, with the code copied by :func:`make_system`."""
        libraries = self.root / "usr" / "lib" / self.machine.triplet
        settings = {
            # Debian chooses these by links that unpacking does not make.
            "LD_LIBRARY_PATH": f"{libraries / 'blas'}:{libraries / 'lapack'}",
            "PYTHONPATH": str(self.folder / "code"),
            # Or the code of the folder it is started in would come first.
            "PYTHONSAFEPATH": "1",
            "PYTHONDONTWRITEBYTECODE": "1",
            "SCARFMT_NATIVE": "1" if self.native else "0",
        }
        set_ = [word for name, value in settings.items() for word in ("-E", f"{name}={value}")]
        python = self.root / "usr" / "bin" / "python3"
        return [*self.machine.qemu, "-L", str(self.root), *set_, str(python), *arguments]


def make_system(machine: Machine, folder: Path) -> System:
    """Unpack a system, unless that is done already; copy the code of this checkout there, and compile the C library.

    Raises:
        Unavailable: a program is missing.
        subprocess.CalledProcessError: apt, dpkg-deb or the compiler failed.
    """
    programs = [machine.qemu[0], machine.compiler, "apt-get", "dpkg-deb"]
    missing = [program for program in programs if shutil.which(program) is None]
    if missing:
        raise Unavailable(
            f"there is no {', '.join(missing)}: apt-get install qemu-user "
            "gcc-s390x-linux-gnu libc6-dev-s390x-cross gcc-aarch64-linux-gnu libc6-dev-arm64-cross"
        )
    system = System(machine, folder / machine.name)
    if not (system.root / "usr/bin/python3").exists():
        _unpack(system, _packages(machine, system.folder / "apt"))
    _copy_code(system.folder / "code")
    _compile(machine, system.folder / "code" / "scarfmt" / "native")
    return system


def _packages(machine: Machine, folder: Path) -> list[Path]:
    """Download Python and what the decoder imports, with all they depend on."""
    for name in ("state/lists/partial", "cache/archives/partial"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    (folder / "status").touch()
    (folder / "apt.conf").write_text(_APT.format(folder=folder, debian=machine.name))
    (folder / "sources.list").write_text(f"deb [signed-by={KEYRING}] {MIRROR} {SUITE} main\n")
    environment = {**os.environ, "APT_CONFIG": str(folder / "apt.conf")}
    for words in (["update"], ["install", "--yes", "--download-only", *PACKAGES]):
        subprocess.run(["apt-get", "--quiet", *words], env=environment, check=True)
    return sorted((folder / "cache" / "archives").glob("*.deb"))


def _unpack(system: System, packages: Sequence[Path]) -> None:
    # Old paths are links into /usr; which ones a package brings differs, and a directory must not be in their place.
    for name in ("bin", "lib", "lib64", "sbin"):
        (system.root / "usr" / name).mkdir(parents=True, exist_ok=True)
        (system.root / name).symlink_to(f"usr/{name}")
    for package in packages:
        subprocess.run(["dpkg-deb", "--extract", str(package), str(system.root)], check=True)


def _copy_code(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    for name in COPIED:
        shutil.copytree(
            REPOSITORY / name, folder / Path(name).name, ignore=shutil.ignore_patterns("*.so", "__pycache__")
        )
    shutil.copytree(STANDIN, folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__"))


def _compile(machine: Machine, folder: Path) -> None:
    sources = sorted(map(str, folder.glob("*.c")))
    library = str(folder / "native.abi3.so")
    subprocess.run([machine.compiler, *NATIVE_FLAGS, "-o", library, *sources, "-lm"], check=True)
