"""Validated integration: enclosures of motions from any exact state, by proven Taylor steps."""
