"""Real roots of polynomials with rational coefficients: moments that are algebraic numbers."""

from flint import arb, fmpq_poly


def real_roots(polynomial: fmpq_poly) -> list[arb]:
    """Return the real roots in growing order, to the bits of the context."""
    found = list[arb]()
    # For rational roots the library gives multiplicities beside them too.
    for pair in polynomial.complex_roots():
        root, _ = tuple(pair)  # type: ignore[arg-type,var-annotated]
        if root.imag == 0:
            found.append(root.real)
    return sorted(found, key=float)
