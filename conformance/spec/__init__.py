"""SPEC.md and its programs: generated tables, worked files of its appendices, which vector covers which rule."""
