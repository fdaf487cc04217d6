"""Computes the classical motions by their reduced quadratures."""
