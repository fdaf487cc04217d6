"""Carlson's symmetric integral of the first kind, in balls."""

from flint import acb, arb


def R_F(x: arb, y: arb, z: arb) -> arb:
    """Return R_F of three numbers ≥ 0, of which at most one is 0."""
    return acb.elliptic_rf(x, y, z).real


def incomplete_first_kind(square: arb, parameter: arb) -> arb:
    """Return F(φ | m) for 0 ≤ φ ≤ π/2 with ``square`` = sin²φ and m < 1."""
    s = square.nonnegative_part()
    return s.sqrt() * R_F((1 - s).nonnegative_part(), 1 - parameter * s, arb(1))
