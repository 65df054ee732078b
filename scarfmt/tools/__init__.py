"""What can be done to a file without making a scene of it: inspect, validate, truncate, dump."""
