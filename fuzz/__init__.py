"""Fuzzing of the reference reader: a mutation campaign and a coverage-guided target."""
