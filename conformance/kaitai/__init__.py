"""The container as a Kaitai Struct description, and the parser compiled from it, held against the reader."""
