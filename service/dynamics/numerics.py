"""The version of what is computed."""

NUMERICS = 1
"""Grows whenever a computed digit may change: solutions of another number are not reused."""
