"""Computes the attitude of the body in space along a motion."""
