"""Blocks of planar motions of one body, in compiled doubles."""
