"""Guesses rational relations between numbers from their digits, by lattice reduction (LLL)."""

from collections.abc import Callable

from flint import arb, ctx, fmpq, fmpz_mat


def rational_relation(numbers: Callable[[], list[arb]], count: int, bits: int) -> list[fmpq] | None:
    """Return c with numbers[count] = Σ c_k numbers[k] to ``bits``, the c of small height, or None.

    A guess, which the caller has to prove. ``numbers`` is called at a precision a little above ``bits``.
    """
    matrix = fmpz_mat(count + 1, count + 2)
    with ctx.workprec(bits + 64):
        for row, value in enumerate(numbers()):
            digits = (value * arb(2) ** bits).mid().floor().unique_fmpz()
            if digits is None:
                return None
            matrix[row, row] = 1
            matrix[row, count + 1] = digits
    shortest = matrix.lll().table()[0]
    factor = int(shortest[count])
    limit = 2 ** (bits // (count + 1) // 2 + 8)
    if factor == 0 or any(abs(int(value)) > limit * (count + 2) for value in shortest):
        return None
    return [fmpq(-int(value), factor) for value in shortest[:count]]
