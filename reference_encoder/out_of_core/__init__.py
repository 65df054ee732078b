"""Encoding scenes larger than a machine: in ranges of space, each by itself, with models fitted to a sample of all."""
