"""Motions of bodies with A = 2C in elliptic functions: a fast method and an independent check."""
