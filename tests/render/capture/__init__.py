"""Cameras from the files that programs write."""
