"""Reads a formula as a sum of real powers of the coordinates: :mod:`.power_sums` decides what it is.

Terms are plain tuples, and a power that is 0 is one and the same object: a sweep reads a million of them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from types import MappingProxyType

from flint import arb, fmpq, fmpz

from service.dynamics.formula.tape import Instruction, Tape

MAX_TERMS = 256
"""Largest number of terms of a sum, before equal ones are added."""
MAX_POWER = 64
"""Power of g2, or of a sum."""
_NAMED: Mapping[str, Callable[[arb], arb]] = MappingProxyType(
    {"exp": arb.exp, "sin": arb.sin, "cos": arb.cos}
)
"""Smooth functions, whose values at numbers stay as they are; a logarithm or root may be one in disguise."""

Constant = tuple[str, tuple[tuple[int, int, int], ...]]
"""A function of Σ (n/m) g2^k: its name, and the n, m and k. To H, which has no ∂V/∂g2, it is a constant."""
Constants = tuple[tuple[Constant, int], ...]
"""With their exponents, in order."""
Term = tuple[fmpq, fmpq, fmpq, fmpq, int, int, int, Constants]
"""The coefficient c and exponents a, b, d of c · constants · |g1|^a |g2|^b |g3|^d; 1 or 0 for each of g1, g2
and g3: whether it is odd there; and the constants."""
PowerSum = list[Term]

ZERO, _ONE = fmpq(0), fmpq(1)
_MINUS = fmpq(-1)


class NotAPowerSumError(Exception):
    """The formula is not, or not plainly, a sum of powers."""


@dataclass(slots=True)
class PowerReader:
    """Reads a tape as a sum of powers; equal ones are not added yet."""

    is_positive: list[bool] = field(default_factory=lambda: [False, False, False])
    """g1, g2 and g3, where a root of them is taken."""

    def read(self, tape: Tape, numbers: Sequence[fmpq] | None) -> PowerSum:
        """Return the terms; ``numbers`` take the places of those of the tape, in order."""
        registers = list(_VARIABLES)
        given = None if numbers is None else iter(numbers)
        for instruction in tape.instructions:
            operation, left, right, number, _ = instruction
            if number is not None:
                value = exact(number) if given is None else next(given)
                if operation == "constant":
                    found: PowerSum = [(value, ZERO, ZERO, ZERO, 0, 0, 0, ())]
                else:
                    found = self._power(registers[left], value)
            elif operation == "multiply":
                found = _product(registers[left], registers[right])
            elif operation == "add":
                found = registers[left] + registers[right]
            else:
                found = self._carried_out(instruction, registers)
            if len(found) > MAX_TERMS:
                raise NotAPowerSumError
            registers.append(found)
        return registers[tape.result]

    def _carried_out(self, instruction: Instruction, registers: Sequence[PowerSum]) -> PowerSum:
        operation, left, right, _, name = instruction
        if operation == "subtract":
            return registers[left] + _negated(registers[right])
        if operation == "divide":
            return _product(registers[left], self._power(registers[right], _MINUS))
        if operation == "negate":
            return _negated(registers[left])
        if operation == "call":
            return _called(name, registers[left])
        raise NotAPowerSumError

    def _power(self, base: PowerSum, exponent: fmpq) -> PowerSum:
        if len(base) != 1:
            return _power_of_sum(base, exponent)
        ((c, a, b, d, one, two, three, constants),) = base
        if (c is _ONE or c == _ONE) and not (one or two or three or b or constants):
            # The usual case: a power of |g1| or |g3|.
            return [(_ONE, a * exponent if a else ZERO, ZERO, d * exponent if d else ZERO, 0, 0, 0, ())]
        # What is infinite at g2 = 0, or too high a sum once g2² is replaced, is left to others.
        if b and not 0 <= b * exponent <= MAX_POWER:
            raise NotAPowerSumError
        a, b, d = (a * exponent if a else ZERO), (b * exponent if b else ZERO), (d * exponent if d else ZERO)
        if exponent.q == 1:
            n = int(exponent.p)
            if -MAX_POWER <= n <= MAX_POWER and c:
                c = c if c is _ONE else c**n
                if constants:
                    constants = tuple((constant, power * n) for constant, power in constants if n)
            elif c != 1 or constants:
                raise NotAPowerSumError
            odd = n % 2
            return [(c, a, b, d, one * odd, two * odd, three * odd, constants)]
        if c != 1 or constants or one + two + three > 1:
            raise NotAPowerSumError
        for index, sign in enumerate((one, two, three)):
            self.is_positive[index] |= bool(sign)
        return [(c, a, b, d, 0, 0, 0, ())]


_VARIABLES: tuple[PowerSum, ...] = (
    [(_ONE, _ONE, ZERO, ZERO, 1, 0, 0, ())],
    [(_ONE, ZERO, _ONE, ZERO, 0, 1, 0, ())],
    [(_ONE, ZERO, ZERO, _ONE, 0, 0, 1, ())],
)


def _power_of_sum(base: PowerSum, exponent: fmpq) -> PowerSum:
    if exponent.q != 1 or not 0 <= exponent <= MAX_POWER or not base:
        raise NotAPowerSumError
    found: PowerSum = [(_ONE, ZERO, ZERO, ZERO, 0, 0, 0, ())]
    for _ in range(int(exponent.p)):
        found = _product(found, base)
        if len(found) > MAX_TERMS:
            break
    return found


def _called(name: str, argument: PowerSum) -> PowerSum:
    if name == "abs" and len(argument) == 1:
        ((c, first, height, third, _, _, _, constants),) = argument
        if height or constants:
            raise NotAPowerSumError
        return [(c if c is _ONE else abs(c), first, height, third, 0, 0, 0, constants)]
    if name not in _NAMED or any(
        constants or first or third or height.q != 1
        for _, first, height, third, _, _, _, constants in argument
    ):
        raise NotAPowerSumError
    heights = added(argument, (True, True, True)) if len(argument) > 1 else argument
    key = tuple((int(c.p), int(c.q), int(height.p)) for c, _, height, *_ in heights if c)
    return [(_ONE, ZERO, ZERO, ZERO, 0, 0, 0, (((name, tuple(sorted(key))), 1),))]


def added(terms: PowerSum, keeps: tuple[bool, bool, bool]) -> PowerSum:
    """Return the terms with equal powers added, those that are not 0.

    Signs are those of g1, g2 and g3 where both are met, as ``keeps`` says; elsewhere there are none.
    """
    sums: PowerSum = []
    # Numerators tell most terms apart, and are found sooner than a ratio's hash.
    alike: dict[tuple[fmpz, fmpz], list[int]] = {}
    first_kept, height_kept, third_kept = keeps
    for c, a, b, d, odd_first, odd_height, odd_third, constants in terms:
        one, two, three = odd_first * first_kept, odd_height * height_kept, odd_third * third_kept
        signs, places = (one, two, three, constants), alike.setdefault((a.p, d.p), [])
        for place in places:
            known = sums[place]
            height = known[2]
            if a == known[1] and d == known[3] and (b is height or b == height) and known[4:] == signs:
                sums[place] = known[0] + c, a, b, d, one, two, three, constants
                break
        else:
            places.append(len(sums))
            sums.append((c, a, b, d, one, two, three, constants))
    return [each for each in sums if each[0]]


def number_of(constants: Constants) -> arb:
    """Return the product of functions of numbers, at the current precision."""
    found = arb(1)
    for (name, argument), power in constants:
        value = sum((arb(fmpq(numerator, denominator)) for numerator, denominator, _ in argument), arb(0))
        found *= _NAMED[name](value) ** power
    return found


def _negated(terms: PowerSum) -> PowerSum:
    return [(-c, a, b, d, one, two, three, constants) for c, a, b, d, one, two, three, constants in terms]


def _product(left: PowerSum, right: PowerSum) -> PowerSum:
    if len(left) * len(right) > MAX_TERMS:
        raise NotAPowerSumError
    return [
        (
            e if c is _ONE else c if e is _ONE else c * e,
            f if a is ZERO else a if f is ZERO else a + f,
            h if b is ZERO else b if h is ZERO else b + h,
            k if d is ZERO else d if k is ZERO else d + k,
            i ^ m,
            j ^ n,
            o ^ q,
            _together(r, t) if r and t else r or t,
        )
        for c, a, b, d, i, j, o, r in left
        for e, f, h, k, m, n, q, t in right
    ]


def _together(left: Constants, right: Constants) -> Constants:
    powers = dict(left)
    for constant, power in right:
        powers[constant] = powers.get(constant, 0) + power
    return tuple(sorted((constant, power) for constant, power in powers.items() if power))


def exact(value: Fraction) -> fmpq:
    """Return a ratio as one of flint's."""
    return fmpq(value.numerator, value.denominator)
