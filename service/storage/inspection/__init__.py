"""Checks the invariants of a database, and repairs violations."""
