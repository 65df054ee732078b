"""Rendering and picture comparison; reading and writing pictures needs the `render` extra (pillow)."""

from __future__ import annotations
