r"""The reduced motion as formulas: p² and the speed of g1 on a curve, as functions of g1.

A planar motion stays on a curve |g3| = λ |g1|^(C/A), which is g3² = ν g1 for A = 2C. The energy
h = V + A p²/2 + C r²/2 then leaves one equation of the first order (H. M. Yehia):

.. math:: p^2 = \frac{2 \gamma_3^2}{A} \frac{h - V}{\alpha\gamma_1^2 + \gamma_3^2}, \qquad
          \dot\gamma_1^2 = \frac{2\alpha \gamma_1^2 \gamma_2^2}{C}
                              \frac{h - V}{\alpha\gamma_1^2 + \gamma_3^2}
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction

from service.dynamics.body import RigidBody
from service.dynamics.formula.printer import exact_tree
from service.dynamics.formula.traversal import fold_tree
from service.dynamics.formula.tree import Binary, Call, Negation, Number, Symbol, Tree

G1 = Symbol("g1")
_ONE = Number(Fraction(1))


@dataclass(frozen=True, slots=True)
class ReducedMotion:
    """Formulas in ``g1`` and ``nu`` or ``lambda``, and in the names of V and h."""

    curve: Tree
    """g3² on the curve."""
    p_squared: Tree
    speed_squared: Tree
    """(dg1/dt)²."""


def reduced_motion(
    body: RigidBody, V: Tree, h: Tree, *, g1_sign: int, g3_sign: int, g2_sign: int
) -> ReducedMotion:
    """Return the reduced motion where g1, g2 and g3 have these signs.

    Parameters
    ----------
    V
        In ``g1``, ``g2``, ``g3``.
    h
        The energy in ``nu`` if A = 2C, else in ``lambda``.

    Raises
    ------
    FormulaLimitError
        A formula has too many nodes.
    EqualMomentsError
        A = C.
    """
    body.require_planar()
    curve = _Curve(body, g1_sign)
    g3_squared = curve.power_of_g3(2)
    first = _power(G1, Fraction(2))
    g2_squared = Binary("-", Binary("-", _ONE, first), g3_squared)
    signs = {"g2": g2_sign, "g3": g3_sign}

    def power_of(name: str, exponent: int) -> Tree:
        is_third = name == "g3"
        root = curve.power_of_g3(exponent) if is_third else _power(g2_squared, Fraction(exponent, 2))
        return Negation(root) if signs[name] < 0 and exponent % 2 else root

    kinetic = Binary("-", h, _substituted(V, power_of))
    weight = Binary("+", _product(body.alpha, first), g3_squared)
    per_weight = Binary("/", kinetic, weight)
    return ReducedMotion(
        g3_squared,
        _product(2 / body.A, g3_squared, per_weight),
        _product(2 * body.alpha / body.C, first, g2_squared, per_weight),
    )


class _Curve:
    """The powers of |g3| on the curve."""

    def __init__(self, body: RigidBody, g1_sign: int) -> None:
        self._body = body
        self._size: Tree = G1 if g1_sign > 0 else Negation(G1)

    def power_of_g3(self, exponent: int) -> Tree:
        """Return |g3|^exponent."""
        if self._body.A == 2 * self._body.C:
            return _power(Binary("*", Symbol("nu"), G1), Fraction(exponent, 2))
        scale = _power(Symbol("lambda"), Fraction(exponent))
        return Binary("*", scale, _power(self._size, exponent / self._body.alpha))


def _substituted(V: Tree, power_of: Callable[[str, int], Tree]) -> Tree:
    """Return V with the powers of g2 and g3 replaced, even ones without roots."""

    def build(_: int, node: Tree, operands: Sequence[Tree]) -> Tree:
        match node:
            case Symbol("g2" | "g3" as name):
                return power_of(name, 1)
            case Binary("^", Symbol("g2" | "g3" as name), exponent) if (n := _whole(exponent)) is not None:
                return power_of(name, n)
            case Negation():
                return Negation(operands[0])
            case Call(function):
                return Call(function, operands[0])
            case Binary(operator):
                return Binary(operator, operands[0], operands[1])
        return node

    return fold_tree(V, build)


def _whole(exponent: Tree) -> int | None:
    match exponent:
        case Number(value) if value.denominator == 1:
            return value.numerator
        case Negation(Number(value)) if value.denominator == 1:
            return -value.numerator
    return None


def _power(base: Tree, exponent: Fraction) -> Tree:
    return base if exponent == 1 else Binary("^", base, exact_tree(exponent))


def _product(number: Fraction, *factors: Tree) -> Tree:
    first, *rest = factors if number == 1 else (exact_tree(number), *factors)
    for factor in rest:
        first = Binary("*", first, factor)
    return first
