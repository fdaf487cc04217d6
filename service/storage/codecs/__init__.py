"""Encodes records and arrays for storage in a table row, and decodes them."""
