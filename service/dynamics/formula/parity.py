"""Decides whether a formula is visibly even in a variable."""

from service.dynamics.formula.algebras.parity import Parity, ParityAlgebra
from service.dynamics.formula.tape import Tape


def is_written_even(tape: Tape, position: int) -> bool:
    """Tell whether the instructions prove that the formula is even in the variable at this position."""
    known: bool | None = tape.derived.get(("even", position))
    if known is None:
        known = tape.derived["even", position] = _is_even(tape, position)
    return known


def _is_even(tape: Tape, position: int) -> bool:
    parities = [Parity.ODD if k == position else Parity.EVEN for k in range(len(tape.variables))]
    return tape.evaluate(ParityAlgebra(), parities) is Parity.EVEN
