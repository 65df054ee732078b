"""`python -m scarfmt` is the `scarfmt` command."""

from __future__ import annotations

from scarfmt.cli import main

if __name__ == "__main__":
    main()
