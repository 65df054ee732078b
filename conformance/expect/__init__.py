"""What a decoder must make of a vector, from the scene it was written from: `expect.json` and the files beside it."""
