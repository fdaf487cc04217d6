"""Chooses the solver of a motion: the table of families, the search through it, and their protocol."""
