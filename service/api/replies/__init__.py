"""Writes answers and errors as JSON."""
