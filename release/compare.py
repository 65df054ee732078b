"""Whether two builds gave the same bytes: ``python -m release.compare ONE OTHER``; 1 and what differs if not."""

from __future__ import annotations

import sys
from pathlib import Path

from release.archives import contents


def differences(one: Path, other: Path) -> list[str]:
    """The differences between the files of two folders, in words; empty if there are none."""
    first, second = ({path.name: path for path in folder.iterdir() if path.is_file()} for folder in (one, other))
    found = [f"{name} is only in one of them" for name in sorted(first.keys() ^ second.keys())]
    for name in sorted(first.keys() & second.keys()):
        if first[name].read_bytes() != second[name].read_bytes():
            found.append(f"{name}: {_inside(first[name], second[name])}")
    return found


def _inside(one: Path, other: Path) -> str:
    """Which members of two archives differ."""
    first, second = contents(one), contents(other)
    names = [name for name in sorted(first.keys() | second.keys()) if first.get(name) != second.get(name)]
    return ", ".join(names) or "equal members, in another order or with other times or modes"


def main() -> int:
    """Command line: 1 if something differs, or if there is nothing."""
    one, other = (Path(name) for name in sys.argv[1:3])
    found = differences(one, other)
    print("\n".join(found) or f"{len(list(one.iterdir()))} files, all of equal bytes")
    return bool(found) or not any(one.iterdir())


if __name__ == "__main__":
    sys.exit(main())
