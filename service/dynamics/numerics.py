"""The version of what is computed."""

NUMERICS = 4
"""Grows whenever a computed digit may change: solutions of another number are not reused."""
