"""How the compiled kernel is built and named; everything else is in pyproject.toml."""

from __future__ import annotations

import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext
from setuptools.errors import CompileError

LIBRARY = "native.pyd" if sys.platform == "win32" else "native.so"
"""No Python version in the name: the kernel is called through ctypes and needs no Python ABI."""
FAILURE = "native.failed.txt"
"""Says in an installation without the kernel why; `scarfmt --version` repeats it."""
_WARNING = """
*** scarfmt: the compiled kernel could not be built; without it all results are the same, and slower.
*** {}
*** Needed are GCC or Clang, found by $CC, and $CFLAGS that it takes.
"""


class BuildKernel(build_ext):
    """Builds the kernel under its plain name, without symbols for a debugger."""

    def get_ext_filename(self, fullname: str) -> str:
        return str(Path(*fullname.split(".")).with_name(LIBRARY))

    def build_extension(self, ext) -> None:  # type: ignore[no-untyped-def]
        if sys.platform == "linux":
            ext.extra_link_args = [*ext.extra_link_args, "-Wl,-s"]
        failure = Path(self.get_ext_fullpath(ext.name)).with_name(FAILURE)
        failure.unlink(missing_ok=True)
        try:
            super().build_extension(ext)
        except Exception as error:
            print(_WARNING.format(error), file=sys.stderr)
            failure.parent.mkdir(parents=True, exist_ok=True)
            failure.with_name(LIBRARY).unlink(missing_ok=True)
            failure.write_text(f"{type(error).__name__}: {' '.join(str(error).split())}\n")
            # The package is installed all the same: the extension is optional.
            raise CompileError(str(error)) from error

    def copy_extensions_to_source(self) -> None:
        # What an older build left has a longer name, which Python would find first.
        kernel = Path("scarfmt/kernel")
        for old in [*kernel.glob("native.*.so"), kernel / FAILURE]:
            old.unlink(missing_ok=True)
        failure = Path(self.build_lib, kernel, FAILURE)
        if failure.exists():
            (kernel / LIBRARY).unlink(missing_ok=True)
            (kernel / FAILURE).write_text(failure.read_text())
        super().copy_extensions_to_source()


class KernelWheel(bdist_wheel):
    """A wheel for every Python 3 of one platform, or of any where the kernel could not be built."""

    def get_tag(self) -> tuple[str, str, str]:
        platform = super().get_tag()[2]
        built = Path(self.bdist_dir or "", "scarfmt", "kernel", LIBRARY).exists()
        return "py3", "none", platform if built else "any"


setup(cmdclass={"build_ext": BuildKernel, "bdist_wheel": KernelWheel})
