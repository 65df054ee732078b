"""Codecs of the sub-streams of a TILE block, encode and decode side by side (SPEC §7.2-§7.7).

Each puts symbols into an emitter or gets them from a reader of symbols; none knows of bytes, of blocks, or of the
compiled kernel. They are the definition: every engine (:mod:`scarfmt.coding.engine`) reads and writes the same.
"""
