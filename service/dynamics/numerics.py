"""The numerics version, raised whenever a computed digit changes."""

NUMERICS = 12
"""Grows whenever a computed digit may change: solutions of another number are not reused."""
