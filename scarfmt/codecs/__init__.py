"""Codecs of the sub-streams of a TILE block, encode and decode side by side (SPEC §7.2-§7.7).

Each puts symbols into an emitter or gets them from a reader of symbols; none knows of bytes or of blocks. They are
the definition: the C library (:mod:`scarfmt.native`) reads the same.
"""
