"""The conformance vectors on other processors, emulated: ``python -m conformance.portability`` (``make portability``).

:mod:`.machines` lists the processors and makes a Debian system of each below ``build/portability/``, the compiled
kernel included. :mod:`.run` has the reference decoder answer the vectors there and records what it found, which
docs/stability.md shows. ``standin/`` takes the place of the one dependency that Debian does not package.
"""
