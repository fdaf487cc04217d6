"""The numerics version, raised whenever a computed digit changes."""

NUMERICS = 13
"""Grows whenever a computed digit may change: solutions of another number are not reused."""
