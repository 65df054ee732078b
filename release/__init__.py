"""The parts of a release: wheel, sdist, npm package, vectors, and a bill of materials. See `docs/under-the-hood.md`."""
