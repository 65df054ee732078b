"""Boxes, views and plans of what to fetch first."""
