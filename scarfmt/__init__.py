"""scarfmt: the `.scar` format for progressive neural-compressed 3D Gaussian scenes. See SPEC.md."""

from __future__ import annotations

__version__ = "0.1.0"
