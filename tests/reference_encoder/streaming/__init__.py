"""The STREAMING block that the encoder writes: viewpoints, errors after each layer, gains, boxes."""
