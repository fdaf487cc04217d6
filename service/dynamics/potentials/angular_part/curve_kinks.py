r"""Finds the kinks of F(w) at zeros of absolute values, and its analytic pieces between them.

Integrals over F are enclosed piece by piece. An integrator that is left alone with a kink halves its way
to it, at several times the price.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

from flint import arb, ctx

from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.rewriting import copied, with_signs
from service.dynamics.formula.tape import Tape

WIDEST = 64
"""Kinks are looked for at |log w| up to this; beyond them F is left as it is."""
MOST_KINKS = 16
MOST_STRETCHES = 2000


@dataclass(frozen=True, slots=True)
class CurvePiece:
    """F by a tape that has no kink where lower ≤ log w ≤ upper, or a kink that is between them."""

    lower: arb
    upper: arb
    tape: Tape
    has_kink: bool


def curve_pieces(tape: Tape) -> tuple[CurvePiece, ...]:
    """Return pieces that cover |log w| ≤ WIDEST, at the current precision; none if F has no kinks there."""
    return _pieces_at(tape, ctx.prec)


@lru_cache(maxsize=64)
def _pieces_at(tape: Tape, bits: int) -> tuple[CurvePiece, ...]:
    arguments = dict.fromkeys(
        made.left for made in tape.instructions if made.operation == "call" and made.name == "abs"
    )
    if not arguments:
        return ()
    builder, registers = copied(tape)
    tapes = {argument: builder.tape(registers[argument]) for argument in arguments}
    with ctx.workprec(bits + 16):
        found = _stretches(list(tapes.values()), bits)
    if found is None or not any(0 in signs for *_, signs in found):
        return ()
    return tuple(
        CurvePiece(
            lower,
            upper,
            with_signs(tape, {a: s for a, s in zip(tapes, signs, strict=True) if s}),
            has_kink=0 in signs,
        )
        for lower, upper, signs in _joined(found)
    )


Stretch = tuple[arb, arb, tuple[int, ...]]


def _stretches(arguments: Sequence[Tape], bits: int) -> list[Stretch] | None:
    """Return stretches of log w in order, with the signs of the arguments, 0 at kinks; None if too many."""
    shortest = arb(2) ** -bits
    pending = [(arb(k), arb(k + 1)) for k in reversed(range(-WIDEST, WIDEST))]
    done: list[Stretch] = []
    for _ in range(MOST_STRETCHES):
        if not pending:
            return done if sum(0 in signs for *_, signs in done) <= 2 * MOST_KINKS else None
        lower, upper = pending.pop()
        w = lower.union(upper).exp()
        signs = tuple(_sign(argument, w) for argument in arguments)
        if 0 not in signs or upper - lower < shortest:
            done.append((lower, upper, signs))
        else:
            middle = ((lower + upper) / 2).mid()
            pending += [(middle, upper), (lower, middle)]
    return None


def _sign(argument: Tape, w: arb) -> int:
    value = argument.evaluate(BallAlgebra(), (w,))
    return 1 if value > 0 else -1 if value < 0 else 0


def _joined(stretches: Sequence[Stretch]) -> Iterator[Stretch]:
    """Yield the stretches with neighbours of the same signs made one."""
    lower, upper, signs = stretches[0]
    for low, high, here in stretches[1:]:
        if here == signs:
            upper = high
        else:
            yield lower, upper, signs
            lower, upper, signs = low, high, here
    yield lower, upper, signs
