"""The version of what is computed."""

NUMERICS = 2
"""Grows whenever a computed digit may change: solutions of another number are not reused."""
