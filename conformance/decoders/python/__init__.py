"""A second decoder, written from SPEC.md alone with the standard library: plain loops, easy to compare a port with."""
