"""Integer networks: contexts and probabilities computed from what is already decoded (SPEC §10)."""
