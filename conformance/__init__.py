"""Conformance vectors of the `.scar` format, and the scripts that make them and SPEC.md's generated tables."""
