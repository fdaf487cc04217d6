"""Periodic planar motions as functions of a phase in which time is smooth."""
