"""Taking sound files apart and putting them together again, every checksum right but the one meant to be wrong.

:mod:`.parts` changes any field of the front by the tables of SPEC.md and uses nothing of the package: faults of the
container. :mod:`.files` changes, adds and removes whole blocks: faults of models and tiles, and tests of damaged files.
The fuzzer's own kit, fuzz/testing/parts.py, damages files that are damaged already.
"""
