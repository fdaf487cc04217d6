"""Rewrites a formula about places where a part of it vanishes that others divide by, or take a logarithm of.

A part that depends on g2 alone, an irreducible polynomial or a function, becomes an input ``u`` of its own.
In an algebra whose scale is |u| the formula then is a power of the scale times something bounded, also where
u is 0 and the formula itself infinite.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction

from flint import fmpq_poly

from service.dynamics.formula.rewriting import RegisterPolynomials, written_in_g2
from service.dynamics.formula.tape import Instruction, Recorder, Tape, without_unused

_G2, _U = 1, 3
_ORDER = (2, 0, _G2)
"""g3² is replaced on the sphere: a polynomial in g2 stays one."""
_VARIABLES = ("g1", "g2", "g3")
_KEEPING_ZEROS = ("multiply", "divide", "negate", "power")


@dataclass(frozen=True, slots=True)
class VanishingPart:
    """A part u of a formula, and the formula with u as a fourth input beside g1, g2, g3."""

    part: Tape
    """u over g1, g2, g3; it depends on g2 alone."""
    whole: Tape


def vanishing_parts(tape: Tape) -> tuple[VanishingPart, ...]:
    """Return the parts that make a formula in g1, g2, g3 infinite, or undefined, where they vanish."""
    found: tuple[VanishingPart, ...] | None = tape.derived.get(vanishing_parts)
    if found is None:
        found = tape.derived[vanishing_parts] = _parts(tape) if tape.variables == _VARIABLES else ()
    return found


def parts_in_g2(tape: Tape) -> tuple[VanishingPart, ...]:
    """Return the parts of a formula in g1, g2, g3 that depend on g2 alone, but for g2 itself."""
    found: tuple[VanishingPart, ...] | None = tape.derived.get(parts_in_g2)
    if found is None:
        names = range(len(_VARIABLES), len(_VARIABLES) + len(tape.instructions))
        reader = _Reader(tape) if tape.variables == _VARIABLES else None
        registers = [k for k in names if reader is not None and reader.is_written_in_g2(k)]
        found = tape.derived[parts_in_g2] = tuple(_by_register(tape, k) for k in registers)
    return found


def with_vanishing(
    tape: Tape, order_of: Callable[[Tape], int | None]
) -> tuple[Tape, tuple[tuple[Tape, int], ...]]:
    """Return a formula with all its parts in g2 alone that vanish at a place as further inputs, and these.

    ``order_of`` tells the order of the zero that a part has there, None if it is none.
    """
    plain = _without_tangents(tape)
    reader, found = _Reader(plain), dict[int, tuple[Tape, int]]()
    for register in range(len(_VARIABLES), len(_VARIABLES) + len(plain.instructions)):
        if reader.is_written_in_g2(register):
            part = without_unused(Tape(plain.variables, plain.instructions, register))
            order = order_of(part)
            if order:
                found[register] = part, order
    recorder = Recorder((*_VARIABLES, *(f"u{k}" for k in range(len(found)))))
    at, numbers = list(range(len(_VARIABLES))), list(found)
    for place, made in enumerate(plain.instructions, start=len(_VARIABLES)):
        is_input = place in found
        at.append(len(_VARIABLES) + numbers.index(place) if is_input else recorder.emit(_moved(made, at)))
    return without_unused(recorder.whole(at[plain.result])), tuple(found.values())


def has_essential_part(part: VanishingPart) -> bool:
    """Tell whether exp, sin, cos or tan is taken of what divides by a part, or holds its logarithm."""
    variables = len(part.whole.variables)
    holds_u, is_infinite = [k == _U for k in range(variables)], [False] * variables
    for made in part.whole.instructions:
        operands = [k for k in (made.left, made.right) if k >= 0]
        if made.name in ("exp", "sin", "cos", "tan") and is_infinite[made.left]:
            return True
        grows = made.name == "log" and holds_u[made.left]
        grows |= made.operation == "divide" and holds_u[made.right]
        grows |= made.number is not None and made.number < 0 and made.left >= 0 and holds_u[made.left]
        is_infinite.append(grows or any(is_infinite[k] for k in operands))
        holds_u.append(any(holds_u[k] for k in operands))
    return False


def _parts(tape: Tape) -> tuple[VanishingPart, ...]:
    plain = _without_tangents(tape)
    reader = _Reader(plain)
    factors, functions = dict[str, fmpq_poly](), list[int]()
    for register in _divisors(plain):
        if not reader.is_in_g2(register):
            continue
        polynomial = reader.polynomial(register)
        if polynomial is None:
            functions.append(register)
        elif polynomial.degree() > 0:
            factors.update((str(factor), factor) for factor, _ in polynomial.factor()[1])
    parts = [_by_factor(plain, reader, factor) for factor in factors.values()]
    return (*parts, *(_by_register(plain, register) for register in functions))


def _without_tangents(tape: Tape) -> Tape:
    """Return the tape with every tangent as a quotient."""
    recorder = Recorder(tape.variables)
    at = list(range(len(tape.variables)))
    for made in tape.instructions:
        if made.name == "tan":
            sine, cosine = (
                recorder.emit(Instruction("call", at[made.left], name=name)) for name in ("sin", "cos")
            )
            at.append(recorder.emit(Instruction("divide", sine, cosine)))
        else:
            at.append(recorder.emit(_moved(made, at)))
    return recorder.whole(at[tape.result])


def _moved(made: Instruction, at: list[int]) -> Instruction:
    left, right = (at[k] if k >= 0 else k for k in (made.left, made.right))
    return made._replace(left=left, right=right)


def _divisors(tape: Tape) -> list[int]:
    """Return the registers at whose zeros a quotient, a power or a logarithm has no finite value."""
    found: dict[int, None] = {}
    for made in tape.instructions:
        if made.operation == "divide":
            found[made.right] = None
        elif (
            made.operation == "general_power"
            or made.name == "log"
            or (
                made.operation == "power"
                and made.number is not None
                and (made.number < 0 or made.number.denominator > 1)
            )
        ):
            found[made.left] = None
    return list(dict.fromkeys(part for register in found for part in _vanishing_in(tape, register)))


def _vanishing_in(tape: Tape, register: int) -> Iterator[int]:
    """Yield the registers one of which vanishes where this one does."""
    made = _instruction(tape, register)
    if made is None or not (made.name == "abs" or made.operation in _KEEPING_ZEROS):
        yield register
        return
    yield from _vanishing_in(tape, made.left)
    if made.operation == "multiply":
        yield from _vanishing_in(tape, made.right)


def _instruction(tape: Tape, register: int) -> Instruction | None:
    place = register - len(tape.variables)
    return None if place < 0 else tape.instructions[place]


class _Reader:
    """Tells of the registers of a tape which depend on g2 alone, and which of them are polynomials."""

    def __init__(self, tape: Tape) -> None:
        recorder = Recorder(tape.variables)
        for made in tape.instructions:
            recorder.emit(made)
        self._polynomials = RegisterPolynomials(recorder, _ORDER)
        self._in_g2 = [k == _G2 for k in range(len(tape.variables))]
        self._has_g2 = list(self._in_g2)
        for made in tape.instructions:
            operands = [k for k in (made.left, made.right) if k >= 0]
            self._in_g2.append(all(self._in_g2[k] for k in operands))
            self._has_g2.append(any(self._has_g2[k] for k in operands))

    def is_written_in_g2(self, register: int) -> bool:
        """Tell whether a register is written with g2, and with nothing but g2 and constants."""
        return self._in_g2[register] and self._has_g2[register]

    def is_in_g2(self, register: int) -> bool:
        """Tell whether a register is written with g2 alone, or is a polynomial in it on the sphere."""
        return self._in_g2[register] or self.polynomial(register) is not None

    def polynomial(self, register: int) -> fmpq_poly | None:
        """Return the polynomial in g2 that a register is on the sphere, None if it is none."""
        return self._polynomials.in_g2(register)


def _by_register(tape: Tape, register: int) -> VanishingPart:
    """Return the part that a register is."""
    recorder = Recorder((*_VARIABLES, "u"))
    at = list(range(len(_VARIABLES)))
    for place, made in enumerate(tape.instructions, start=len(_VARIABLES)):
        at.append(_U if place == register else recorder.emit(_moved(made, at)))
    part = without_unused(Tape(tape.variables, tape.instructions, register))
    return VanishingPart(part, without_unused(recorder.whole(at[tape.result])))


def _by_factor(tape: Tape, reader: _Reader, factor: fmpq_poly) -> VanishingPart:
    """Return the part that is an irreducible polynomial: what it divides is written with it."""
    recorder = Recorder((*_VARIABLES, "u"))
    at: list[int] = []
    for register in range(len(_VARIABLES) + len(tape.instructions)):
        made, polynomial = _instruction(tape, register), reader.polynomial(register)
        power, cofactor = _divided(polynomial, factor)
        if not power:
            at.append(register if made is None else recorder.emit(_moved(made, at)))
            continue
        new = _U if power == 1 else recorder.emit(Instruction("power", _U, number=Fraction(power)))
        at.append(recorder.emit(Instruction("multiply", new, written_in_g2(recorder, cofactor))))
    part = Recorder(_VARIABLES)
    return VanishingPart(
        part.whole(written_in_g2(part, factor)), without_unused(recorder.whole(at[tape.result]))
    )


def _divided(polynomial: fmpq_poly | None, factor: fmpq_poly) -> tuple[int, fmpq_poly]:
    """Return how often a factor divides a polynomial, and what is left."""
    rest, power = polynomial or fmpq_poly([0]), 0
    while rest.degree() > 0:
        quotient, remainder = divmod(rest, factor)
        if remainder.degree() >= 0:
            break
        rest, power = quotient, power + 1
    return power, rest
