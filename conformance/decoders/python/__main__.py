"""``python -m conformance.decoders.python FILE --layers K --stage STAGE`` answers as PROTOCOL.md says."""

import sys

from conformance.decoders.python.answers import main

sys.exit(main(sys.argv[1:]))
