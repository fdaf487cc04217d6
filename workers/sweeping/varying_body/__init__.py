"""Blocks of motions whose bodies, exponents or potentials differ."""
