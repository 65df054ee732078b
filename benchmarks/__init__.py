"""Measurements on real scenes; each module is a command that rewrites its part of docs/benchmarks.md."""
