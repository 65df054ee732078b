"""Tests of scarfmt.viewer."""
