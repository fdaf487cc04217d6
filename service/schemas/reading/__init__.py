"""Reads any document: strict JSON, exact numbers, all faults at once with their places."""
