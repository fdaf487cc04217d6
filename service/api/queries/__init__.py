"""Reads URL queries and the header Prefer."""
