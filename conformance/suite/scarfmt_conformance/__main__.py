"""``python -m scarfmt_conformance``: what ``scarfmt conformance`` does."""

import sys

from scarfmt.cli import main

sys.argv[1:1] = ["conformance"]
main()
