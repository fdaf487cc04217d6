"""Exact arithmetic for proofs: elements of a ring, their factors, their signs."""
