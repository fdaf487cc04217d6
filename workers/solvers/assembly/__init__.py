"""Assembles a motion from a function that samples it: dense output, claimed error, conventions."""
