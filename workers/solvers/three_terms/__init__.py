"""Potentials of three terms: intervals, mirror images and phases of their motions."""
