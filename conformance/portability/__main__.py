"""``python -m conformance.portability``."""

import sys

from conformance.portability.run import main

sys.exit(main())
