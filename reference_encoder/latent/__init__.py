"""Harmonics or features as a latent: basis or autoencoder, codebooks, codewords (paper §3.2, §3.3, §3.6)."""
