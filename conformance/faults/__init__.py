"""Vectors that a decoder must or may refuse: sound files with one rule broken, all other checksums right."""
