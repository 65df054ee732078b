"""How the compiled libraries are built and named; everything else is in pyproject.toml."""

from __future__ import annotations

import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext
from setuptools.errors import CompileError

LIBRARY = "native.pyd" if sys.platform == "win32" else "native.so"
"""No Python version in the name: libraries are called through ctypes and need no Python ABI."""
LIBRARIES = {
    "scarfmt.native.native": "without it all results are the same, and slower",
    "scarfmt.render.native.native": "without it nothing can be drawn, encoded, or trained on a CPU",
}
"""The loss if a library could not be built."""
FAILURE = "native.failed.txt"
"""Says in an installation without a library why; of the kernel, `scarfmt --version` repeats it."""
_WARNING = """
*** scarfmt: {} could not be built; {}.
*** {}
*** Needed are GCC or Clang, found by $CC, and $CFLAGS that it takes.
"""


class BuildLibraries(build_ext):
    """Builds the libraries under their plain names, without symbols for a debugger."""

    def get_ext_filename(self, fullname: str) -> str:
        return str(Path(*fullname.split(".")).with_name(LIBRARY))

    def build_extension(self, ext) -> None:  # type: ignore[no-untyped-def]
        if sys.platform == "linux":
            ext.extra_link_args = [*ext.extra_link_args, "-Wl,-s"]
            # The folder of the sources leaves no trace: the same sources give the same bytes.
            ext.extra_compile_args = [*ext.extra_compile_args, f"-ffile-prefix-map={Path.cwd()}=."]
        failure = Path(self.get_ext_fullpath(ext.name)).with_name(FAILURE)
        failure.unlink(missing_ok=True)
        try:
            super().build_extension(ext)
        except Exception as error:
            print(_WARNING.format(ext.name, LIBRARIES[ext.name], error), file=sys.stderr)
            failure.parent.mkdir(parents=True, exist_ok=True)
            failure.with_name(LIBRARY).unlink(missing_ok=True)
            failure.write_text(f"{type(error).__name__}: {' '.join(str(error).split())}\n")
            # The package is installed all the same: the extension is optional.
            raise CompileError(str(error)) from error

    def copy_extensions_to_source(self) -> None:
        for folder in (Path(*name.split(".")).parent for name in LIBRARIES):
            # What an older build left has a longer name, which Python would find first.
            for old in [*folder.glob("native.*.so"), folder / FAILURE]:
                old.unlink(missing_ok=True)
            failure = Path(self.build_lib, folder, FAILURE)
            if failure.exists():
                (folder / LIBRARY).unlink(missing_ok=True)
                (folder / FAILURE).write_text(failure.read_text())
        super().copy_extensions_to_source()


class LibraryWheel(bdist_wheel):
    """A wheel for every Python 3 of one platform, or of any where no library could be built."""

    def get_tag(self) -> tuple[str, str, str]:
        platform = super().get_tag()[2]
        names = (Path(self.bdist_dir or "", *name.split(".")).with_name(LIBRARY) for name in LIBRARIES)
        built = any(name.exists() for name in names)
        return "py3", "none", platform if built else "any"


setup(cmdclass={"build_ext": BuildLibraries, "bdist_wheel": LibraryWheel})
