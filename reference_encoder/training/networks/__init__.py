"""Training the integer networks, and keeping those that make the file smaller (SPEC §10; paper §3.4, §3.5)."""
