"""The parts of a release: built twice, compared, installed and used."""
