"""Planar periodic motions in compiled doubles: fast, each with a measured bound of its error."""
