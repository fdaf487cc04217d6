"""Bounds of functions on discs: arithmetic, derivatives, and discs around places of the loop."""
