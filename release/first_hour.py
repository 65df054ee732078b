"""Try the commands of README and the guides where nothing is installed, as a newcomer pastes them.

    python -m release.first_hour                        # the pages of `PAGES`
    python -m release.first_hour docs/train.md          # one more: it installs torch

The `sh` blocks of a page run in their order, in a copy of the last commit, with an empty environment of Python. A page
that installs nothing follows README's installation. Other blocks show commands for files that a reader has.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
README = "README.md"
PAGES = (README, "docs/compress.md", "docs/web-page.md", "docs/write-a-decoder.md")
SHELL = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)
PYTHON = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
INSTALL = re.compile(r"^(?:python3 -m venv|pip install) .*\n", re.MULTILINE)


def script_of(text: str) -> str:
    """The commands of a page."""
    return "".join(SHELL.findall(text))


def try_page(page: str, place: Path) -> int:
    """The exit status of the commands of a page, which are printed as they run.

    Args:
        place: an empty folder.
    """
    checkout, programs = place / "checkout", place / "venv" / "bin"
    checkout.mkdir()
    archive = subprocess.run(["git", "archive", "HEAD"], cwd=REPOSITORY, stdout=subprocess.PIPE, check=True)
    subprocess.run(["tar", "-x"], cwd=checkout, input=archive.stdout, check=True)
    venv.create(place / "venv", with_pip=True)
    text = (checkout / page).read_text(encoding="utf-8")
    script = script_of(text)
    if not INSTALL.search(script):
        script = "".join(INSTALL.findall(script_of((checkout / README).read_text(encoding="utf-8")))) + script
    for program in PYTHON.findall(text):
        (checkout / "mine.py").write_text(program, encoding="utf-8")
    variables = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    variables["PATH"] = f"{programs}{os.pathsep}{os.environ['PATH']}"
    return subprocess.run(["sh", "-eux"], input=script, cwd=checkout, env=variables, text=True, check=False).returncode


def main(pages: list[str]) -> int:
    """1 if the commands of a page fail."""
    for page in pages or PAGES:
        print(f"== {page}", flush=True)
        with tempfile.TemporaryDirectory(prefix="scarfmt-") as place:
            if status := try_page(page, Path(place)):
                print(f"{page}: exit status {status}", file=sys.stderr)
                return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
