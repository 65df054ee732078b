"""The data of the STREAMING block: tight boxes of tiles, and the gain of each layer of a tile."""
