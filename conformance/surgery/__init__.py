"""Taking files apart and putting them together again, every checksum right but the one meant to be wrong.

:mod:`.parts` changes any field of the front by the tables of SPEC.md: faults of the container. :mod:`.files` changes,
adds and removes whole blocks: faults of models and tiles. :mod:`.reseal` makes the checksums of damaged files right.
Tests and the fuzzer damage files with all three.
"""
