"""Motions of bodies with A = 2C in elliptic functions: a fast path and an independent witness."""
