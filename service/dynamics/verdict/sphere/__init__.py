"""Cuts the unit sphere into pieces on which a formula is analytic."""
