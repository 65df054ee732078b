"""Rendering and picture comparison; needs the `render` extra (numba, pillow)."""

from __future__ import annotations
