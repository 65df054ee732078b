"""Gives the wheel its version, the vectors as one file, and the texts of the licences; pyproject.toml says the rest."""

import re
import shutil
import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

HERE = Path(__file__).resolve().parent
CONFORMANCE, REPOSITORY = HERE.parent, HERE.parents[1]
sys.path.insert(0, str(HERE))

from scarfmt_conformance.archive import OWN, pack  # noqa: E402


class BuildWithVectors(build_py):
    """Builds the package; an editable one is left without the file and finds the vectors of the checkout."""

    def run(self) -> None:
        super().run()
        if self.editable_mode:
            return
        package = Path(self.build_lib) / "scarfmt_conformance"
        pack(CONFORMANCE, package / OWN.name)
        for name in ("LICENSE", "LICENSE-CC0"):
            shutil.copyfile(REPOSITORY / name, package / name)


# The version of the package beside it, which is not imported: it may not be installed.
MODULE = (REPOSITORY / "scarfmt" / "__init__.py").read_text(encoding="utf-8")
setup(version=re.search(r'^__version__ = "(.+)"$', MODULE, re.M)[1], cmdclass={"build_py": BuildWithVectors})
