r"""Real algebraic numbers as values of formulas, with a proven test for zero.

Every number is U/L with algebraic integers U, L of one field, and bounds u, l of all their
conjugates (Burnikel, Funke, Mehlhorn, Schirra and Schmitt, ESA 2001). The field has at most the
degree D = product of the degrees of the roots a number is made of, so the norm of U ≠ 0 gives

.. math:: |U/L| \ge \frac{1}{l\, u^{D-1}} .

A number that is proved to be smaller, by its ball, is zero. What a formula calls exp, log, sin, …
is a number of this kind only where its argument makes it one, as exp(0). Of other numbers, such as sin(1/3),
only identities of the field are known: they are sums of monomials in functions of each other, and a sum
without terms is zero.
"""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from math import inf, log2

from flint import arb, ctx, fmpz

from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.monomials import (
    ALL_ATOMS,
    ONE,
    MonomialAlgebra,
    MonomialSum,
    NotAMonomialSumError,
    Rules,
    as_fmpq,
)

FORMS = Rules(atoms=ALL_ATOMS, most_atoms=64, most_argument_terms=16, most_terms=64, most_power=16)
LARGEST_EXACT = 4096
"""Bits of numerators and denominators up to which rationals stay rationals."""


class NotAlgebraicError(Exception):
    """The number is transcendental, or has no value, and nothing of it is proved."""


class MoreBitsNeededError(Exception):
    """A zero test needs balls of so many bits."""

    def __init__(self, bits: int) -> None:
        super().__init__(bits)
        self.bits = bits


@dataclass(frozen=True, slots=True)
class Algebraic:
    """A number U/L."""

    ball: arb
    exact: Fraction | None
    up: float
    """log2 of u; inf for a number that is not known to be algebraic."""
    down: float
    """log2 of l."""
    roots: frozenset[tuple[int, int]]
    """The roots it is made of: their numbers and degrees."""
    form: MonomialSum | None = None
    """The same number by functions of others; None if it has too many terms, or something else in it."""


class AlgebraicAlgebra:
    """Algebraic numbers at the current ``flint.ctx.prec``, which must not change; an Algebra."""

    def __init__(self) -> None:
        self._balls = BallAlgebra()
        self._known: dict[tuple[int, Fraction], tuple[Algebraic, Algebraic]] = {}
        self._count = 0
        self._forms = MonomialAlgebra(FORMS)
        self._undone: dict[tuple[str, frozenset[object]], Algebraic] = {}
        """The x of each exp(x), under log, and of each log(x), under exp."""

    def is_zero(self, operand: Algebraic) -> bool:
        """Tell whether the number is 0.

        Raises
        ------
        MoreBitsNeededError
            The balls are too wide to decide.
        NotAlgebraicError
            The number is not known to be algebraic, and its ball contains 0.
        """
        if operand.exact is not None:
            return operand.exact == 0
        if not operand.ball.is_finite():
            raise NotAlgebraicError
        if not operand.ball.contains(0):
            return False
        if operand.up == inf:
            raise NotAlgebraicError
        degree = 1
        for _, each in operand.roots:
            degree *= each
        # Floats of logarithms: a few units more than what was added up.
        bits = 1.001 * (operand.down + operand.up * (degree - 1)) + 8.0
        if not bits < inf:
            raise NotAlgebraicError
        if abs(operand.ball).upper() < arb(2) ** -int(bits + 1.0):
            return True
        raise MoreBitsNeededError(int(bits) + 64 + 2 * operand.ball.bits().bit_length())

    def constant(self, value: Fraction) -> Algebraic:
        """Return an exact number."""
        ball = self._balls.constant(value)
        if value == 0:
            return Algebraic(ball, value, 0.0, 0.0, frozenset(), {})
        up, down = _log2(abs(value.numerator)), _log2(value.denominator)
        is_short = max(up, down) <= LARGEST_EXACT
        form = {ONE: as_fmpq(value)} if is_short else None
        return Algebraic(ball, value if is_short else None, up, down, frozenset(), form)

    def pi(self) -> Algebraic:
        """Return π."""
        return self.transcendental(arb.pi(), self._forms.pi())

    def add(self, left: Algebraic, right: Algebraic) -> Algebraic:
        """Return left + right."""
        if left.exact is not None and right.exact is not None:
            return self.constant(left.exact + right.exact)
        if left.exact == 0:
            return right
        if right.exact == 0:
            return left
        up = max(left.up + right.down, left.down + right.up) + 1.0
        form = _form(self._forms.add, left, right)
        return self._made(left.ball + right.ball, up, left.down + right.down, left, right, form=form)

    def subtract(self, left: Algebraic, right: Algebraic) -> Algebraic:
        """Return left - right."""
        return self.constant(Fraction(0)) if left is right else self.add(left, self.negate(right))

    def negate(self, operand: Algebraic) -> Algebraic:
        """Return -operand."""
        exact = None if operand.exact is None else -operand.exact
        form = _form(self._forms.negate, operand)
        return Algebraic(-operand.ball, exact, operand.up, operand.down, operand.roots, form)

    def multiply(self, left: Algebraic, right: Algebraic) -> Algebraic:
        """Return left · right; what is not algebraic is finite, and makes 0 of 0."""
        if left.exact is not None and right.exact is not None:
            return self.constant(left.exact * right.exact)
        for one, other in ((left, right), (right, left)):
            if one.exact == 1:
                return other
            if one.exact == 0 or (other.up == inf and one.up < inf and self.is_zero(one)):
                if not other.ball.is_finite():
                    raise NotAlgebraicError
                return self.constant(Fraction(0))
        ball, form = left.ball * right.ball, _form(self._forms.multiply, left, right)
        return self._made(ball, left.up + right.up, left.down + right.down, left, right, form=form)

    def divide(self, left: Algebraic, right: Algebraic) -> Algebraic:
        """Return left / right; raises NotAlgebraicError for a division by 0."""
        if self.is_zero(right):
            raise NotAlgebraicError
        if right.exact is not None:
            return self.multiply(left, self.constant(1 / right.exact))
        form = _form(lambda x: self._forms.power(x, Fraction(-1)), right)
        inverse = Algebraic(1 / right.ball, None, right.down, right.up, right.roots, form)
        if right.up == inf:
            inverse = self.transcendental(1 / right.ball, form)
        return self.multiply(left, inverse)

    def power(self, base: Algebraic, exponent: Fraction) -> Algebraic:
        """Return base^exponent; a base below 0 has integer powers only."""
        if exponent < 0:
            return self.divide(self.constant(Fraction(1)), self.power(base, -exponent))
        whole, denominator = exponent.numerator, exponent.denominator
        root = base if denominator == 1 else self._root(base, denominator)
        if root.exact is not None and whole * root.exact.numerator.bit_length() <= LARGEST_EXACT:
            return self.constant(root.exact**whole)
        ball = self._balls.power(root.ball, Fraction(whole))
        form = _form(lambda x: self._forms.power(x, Fraction(whole)), root)
        return self._made(ball, whole * root.up, whole * root.down, root, form=form)

    def general_power(self, base: Algebraic, exponent: Algebraic) -> Algebraic:
        """Return exp(exponent · log(base))."""
        if exponent.exact is not None:
            return self.power(base, exponent.exact)
        return self.call("exp", self.multiply(exponent, self.call("log", base)))

    def call(self, name: str, argument: Algebraic) -> Algebraic:
        """Return the function."""
        if name in ("abs", "sign"):
            sign = 0 if self.is_zero(argument) else 1 if argument.ball > 0 else -1
            if name == "sign":
                return self.constant(Fraction(sign))
            return argument if sign > 0 else self.negate(argument)
        special = _SPECIAL[name]
        if argument.up < inf and self.is_zero(self.add(argument, self.constant(Fraction(-special[0])))):
            return self.constant(Fraction(special[1]))
        form = _form(lambda x: self._forms.call(name, x), argument)
        undone = None if argument.form is None else self._undone.get((name, frozenset(argument.form.items())))
        if undone is not None:
            return undone
        found = self.transcendental(self._balls.call(name, argument.ball), form)
        if form is not None and name in _UNDOING and found.ball.is_finite():
            self._undone[_UNDOING[name], frozenset(form.items())] = argument
        return found

    def root_of(
        self, equation: Callable[[arb], arb], near: arb, *, degree: int, up: float, down: float, of: Algebraic
    ) -> Algebraic:
        """Return the zero next to ``near`` of a polynomial over the numbers of ``of``.

        The caller knows the bounds of it. Raises NotAlgebraicError if no change of sign is found.
        """
        return self._made(_zero_next_to(equation, near), up, down, of, extra=(self._number(), degree))

    def _root(self, base: Algebraic, degree: int) -> Algebraic:
        key = (id(base), Fraction(1, degree))
        if key in self._known:
            return self._known[key][1]
        root = self._new_root(base, degree)
        # The base is kept: its id stays its own.
        self._known[key] = (base, root)
        return root

    def _new_root(self, base: Algebraic, degree: int) -> Algebraic:
        if self.is_zero(base):
            return self.constant(Fraction(0))
        if not base.ball > 0:
            raise NotAlgebraicError
        if base.exact is not None:
            parts = [_exact_root(part, degree) for part in base.exact.as_integer_ratio()]
            if parts[0] is not None and parts[1] is not None:
                return self.constant(Fraction(parts[0], parts[1]))
        ball = self._balls.power(base.ball, Fraction(1, degree))
        form = _form(lambda x: self._forms.power(x, Fraction(1, degree)), base)
        if base.up == inf:
            return self.transcendental(ball, form)
        up, down, k = base.up, base.down, degree
        if up >= down:
            up = (up + (k - 1) * down) / k
        else:
            down = ((k - 1) * up + down) / k
        return self._made(ball, up, down, base, extra=(self._number(), degree), form=form)

    def _number(self) -> int:
        self._count += 1
        return self._count

    def transcendental(self, ball: arb, form: MonomialSum | None = None) -> Algebraic:
        """Return a number of which its ball is known, and perhaps how it is made, and nothing else."""
        return Algebraic(ball, None, inf, 0.0, frozenset(), form)

    def _made(
        self,
        ball: arb,
        up: float,
        down: float,
        *of: Algebraic,
        extra: tuple[int, int] | None = None,
        form: MonomialSum | None = None,
    ) -> Algebraic:
        if up == inf:
            is_nothing = form is not None and not form and ball.is_finite()
            return self.constant(Fraction(0)) if is_nothing else self.transcendental(ball, form)
        roots = frozenset[tuple[int, int]]().union(*(each.roots for each in of))
        return Algebraic(ball, None, up, down, roots if extra is None else roots | {extra}, form)


_SPECIAL = {"exp": (0, 1), "log": (1, 0), "sin": (0, 0), "cos": (0, 1), "tan": (0, 0)}
"""The algebraic argument at which a function has an algebraic value, and that value."""
_UNDOING = {"exp": "log", "log": "exp"}


def _form(make: Callable[..., MonomialSum], *of: Algebraic) -> MonomialSum | None:
    forms = [each.form for each in of if each.form is not None]
    if len(forms) < len(of):
        return None
    try:
        return make(*forms)
    except NotAMonomialSumError:
        return None


def _zero_next_to(equation: Callable[[arb], arb], near: arb) -> arb:
    """Return the ball of a zero, proved by the signs at its ends; the secant method finds it."""
    x = near.mid()
    step = (abs(x) * arb(2) ** -40).mid() if x != 0 else arb(2) ** -40
    before, x = x, (x + step).mid()
    at_before, at_x = equation(before).mid(), equation(x).mid()
    for _ in range(16 + 2 * ctx.prec.bit_length()):
        if at_x == at_before or at_x == 0:
            break
        before, x, at_before = x, (x - at_x * (x - before) / (at_x - at_before)).mid(), at_x
        at_x = equation(x).mid()
    radius = ((abs(x) + arb(2) ** -64) * arb(2) ** (16 - ctx.prec)).mid()
    for _ in range(24):
        low, high = equation((x - radius).mid()), equation((x + radius).mid())
        if (low > 0 and high < 0) or (low < 0 and high > 0):
            return arb(x, radius)
        radius = (radius * 4).mid()
    raise NotAlgebraicError


def _log2(value: int) -> float:
    return log2(value) if value.bit_length() < 1000 else float(value.bit_length())


def _exact_root(value: int, degree: int) -> int | None:
    root = int(fmpz(value).root(degree))
    return root if root**degree == value else None
