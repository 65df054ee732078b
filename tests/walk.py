"""Runs one `scarfmt` command and prints, as JSON, which functions of the product it entered: [[file, name], ...].

What runs while a module is imported does not count, nor do comprehensions and lambdas.
"""

from __future__ import annotations

import contextlib
import inspect
import json
import sys
import threading
from pathlib import Path
from types import FrameType

REPOSITORY = Path(__file__).resolve().parents[1]
PRODUCT = tuple(str(REPOSITORY / name) for name in ("scarfmt", "reference_encoder", "reference_decoder"))

entered: set[tuple[str, str]] = set()
importing = threading.local()
"""Depth of module bodies that run in each thread."""


def note(frame: FrameType, event: str, _argument: object) -> None:
    """Profile function: keep the code of each call that no module body makes."""
    code = frame.f_code
    if code.co_name == "<module>":
        importing.depth = getattr(importing, "depth", 0) + {"call": 1, "return": -1}.get(event, 0)
    if event != "call" or getattr(importing, "depth", 0) or not code.co_filename.startswith(PRODUCT):
        return
    if code.co_flags & inspect.CO_NEWLOCALS and not code.co_name.startswith("<"):
        entered.add((str(Path(code.co_filename).relative_to(REPOSITORY)), code.co_qualname))


def main() -> None:
    """Trace the command of the arguments."""
    sys.path.insert(0, str(REPOSITORY))
    from scarfmt.cli import main as command

    threading.setprofile(note)
    sys.setprofile(note)
    with contextlib.suppress(SystemExit):
        command()
    sys.setprofile(None)
    print("\n" + json.dumps(sorted(entered)))


if __name__ == "__main__":
    main()
