"""Rendering and picture comparison; needs the `render` extra (numba, pillow, scipy)."""

from __future__ import annotations
