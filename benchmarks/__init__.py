"""Measurements on real scenes; each module with a command rewrites its part of docs/. All at once: `make bench`."""
