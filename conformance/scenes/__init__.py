"""The scenes of the vectors that a decoder must accept: by hand, at random from SHA-256, and at every edge."""
