"""Decoders written from SPEC.md alone, sharing no code with the reference: Python here, JavaScript in `js/`."""
