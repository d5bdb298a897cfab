"""Runs of the remote manipulator: what is done with a station, and what is told of it."""
