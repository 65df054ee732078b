"""From photos to a file: a capture read, an anchor scene trained jointly with what codes it, and the bytes written."""
