"""The conformance vectors on other processors, emulated: ``python -m conformance.portability`` (``make portability``).

:mod:`.machines` lists the processors and makes a Debian system of each below ``build/portability/``, the C
library included. :mod:`.run` has the reference decoder answer the vectors there and prints what it found.
``standin/`` takes the place of the one dependency that Debian does not package.
"""
