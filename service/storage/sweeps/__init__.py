"""Sweeps, their chunks, and the points in them."""
