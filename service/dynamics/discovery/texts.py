"""Polynomials as formulas."""

from flint import fmpz_mpoly


def factored_text(polynomial: fmpz_mpoly) -> str:
    """Return the polynomial as a product of irreducible factors, shorter ones first, with its sign."""
    if polynomial.is_constant():
        return str(polynomial)
    constant, factors = polynomial.factor()
    pieces = []
    for factor, power in sorted(factors, key=lambda each: (len(each[0]), str(each[0]))):
        is_only = len(factors) == 1 and power == 1 and constant == 1
        piece = str(factor) if len(factor) == 1 or is_only else f"({factor})"
        pieces.append(piece if power == 1 else f"{piece}^{power}")
    text = "*".join(pieces)
    return text if constant == 1 else f"-{text}" if constant == -1 else f"{constant}*{text}"
