"""Writes roots, logarithms, exponentials, sines and cosines as elements of the ring."""
