"""Stores sweeps and their chunks, and reads their points."""
