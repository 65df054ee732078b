"""How the compiled kernel is built and named; everything else is in pyproject.toml."""

from __future__ import annotations

import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext

LIBRARY = "native.pyd" if sys.platform == "win32" else "native.so"
"""No Python version in the name: the kernel is called through ctypes and needs no Python ABI."""


class BuildKernel(build_ext):
    """Builds the kernel under its plain name, without symbols for a debugger."""

    def get_ext_filename(self, fullname: str) -> str:
        return str(Path(*fullname.split(".")).with_name(LIBRARY))

    def build_extension(self, ext) -> None:  # type: ignore[no-untyped-def]
        if sys.platform == "linux":
            ext.extra_link_args = [*ext.extra_link_args, "-Wl,-s"]
        super().build_extension(ext)

    def copy_extensions_to_source(self) -> None:
        # What an older build left has a longer name, which Python would find first.
        for old in Path("scarfmt/kernel").glob("native.*.so"):
            old.unlink()
        super().copy_extensions_to_source()


class KernelWheel(bdist_wheel):
    """A wheel for every Python 3 of one platform, or of any where the kernel could not be built."""

    def get_tag(self) -> tuple[str, str, str]:
        platform = super().get_tag()[2]
        built = Path(self.bdist_dir or "", "scarfmt", "kernel", LIBRARY).exists()
        return "py3", "none", platform if built else "any"


setup(cmdclass={"build_ext": BuildKernel, "bdist_wheel": KernelWheel})
