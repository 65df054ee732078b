"""Tools that read or change a file without making a scene of it: inspect, validate, truncate, dump."""
