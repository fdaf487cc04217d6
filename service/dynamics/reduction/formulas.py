r"""The reduced motion as formulas: p² and the speed of g1 on a curve, as functions of g1.

A planar motion stays on a curve |g3| = λ |g1|^(C/A), which is g3² = ν g1 for A = 2C. The energy
h = V + A p²/2 + C r²/2 then leaves one equation of the first order (H. M. Yehia):

.. math:: p^2 = \frac{2 \gamma_3^2}{A} \frac{h - V}{\alpha\gamma_1^2 + \gamma_3^2}, \qquad
          \dot\gamma_1^2 = \frac{2\alpha \gamma_1^2 \gamma_2^2}{C}
                              \frac{h - V}{\alpha\gamma_1^2 + \gamma_3^2}

For A = 2C and V = a1 g1 + c1 (g1² − g2²) + b1/g3² the motion itself is a formula in elliptic functions.
With x = |g1|, ν = g3²/|g1|, and a1 times the sign of g1 written as a1, the reduced equation is

.. math:: \dot x^2 = \frac{2}{C\nu^2} (x_E - x)(x - x_{E'}) (-P(x)), \quad
          P = 2 b_1 + \nu^2 a_1 x + 2\nu^2 c_1 x^2, \quad x_E x_{E'} = -1, \quad x_E + x_{E'} = -\nu .

Between its turning points x1 < x2 it is (x − x1)(x2 − x) k(x), k a polynomial of degree two at most, and

.. math:: x = \frac{x_1 (1 + c) + \kappa x_2 (1 - c)}{1 + c + \kappa (1 - c)}, \quad
   c = \mathrm{cn}(\Omega t | m), \quad
   \Omega^4 = k(x_1) k(x_2), \quad \kappa^2 = \frac{k(x_1)}{k(x_2)}, \quad
   m = \frac12 - \frac{k(x_1) + k(x_2) - k_2 (x_2 - x_1)^2}{4 \Omega^2}

with k2 the coefficient of x² in k, t = 0 at x1, and the period 4 K(m)/Ω of x.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from types import MappingProxyType

from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.parameters import whole_number
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.formula.tree import (
    Binary,
    Call,
    Negation,
    Number,
    Symbol,
    Tree,
    exact_tree,
    fold_tree,
    with_operands,
)
from service.dynamics.potentials.recognition import ThreeTerms
from service.dynamics.reduction.window import Window

_BITS = 128
_TURNING_POINT_DISTANCE = Fraction(1, 10**9)
"""A turning point in doubles is that close to the root that it is; a window ends nowhere else."""


_MEANT = MappingProxyType({"k1": "k(x1)", "k2": "k(x2)", "K": "K(m)", "c": "cn", "z": "cn(Omega*t | m)"})
"""Values of functions that the grammar does not know: symbols of these names stand for them."""


def elliptic_motion(
    body: RigidBody, terms: ThreeTerms, nu: Fraction, g1_sign: int, window: Window
) -> dict[str, Tree] | None:
    """Return the motion in a window of the curve g3² = ν g1; None if it has no such formulas.

    The formulas have the names of what they are: ``g1`` is written with x1, x2, kappa and cn, each of
    which is explained by one of the others. ``period`` is that of all six variables.

    Parameters
    ----------
    nu
        |ν|.
    """
    ends = tuple(window.ends)
    if body.A != 2 * body.C or window.kind != "periodic" or ends not in _KINDS:
        return None
    a1 = g1_sign * terms.a1
    roots = [*_roots(a1, terms.b1, terms.c1, nu)]
    inner = "0" if ends[0] == "pole" else _nearest(roots, abs(window.g1[0]))
    equator = f"2/({nu} + sqrt({nu * nu + 4}))"
    outer = equator if ends[1] == "equator" else _nearest(roots, abs(window.g1[1]))
    if inner is None or outer is None or inner == outer:
        return None
    k, square = _cofactor(body, a1, terms.c1, nu, inner, ends)
    # The coefficient of x² in k is −4 c1/C.
    bent = f"{'+' if square < 0 else '-'} {abs(square)}*(x2 - x1)^2" if square else ""
    sign = "-" if g1_sign < 0 else ""
    return {
        "g1": _formula(f"{sign}(x1*(1 + c) + kappa*x2*(1 - c))/(1 + c + kappa*(1 - c))"),
        "cn": _formula("z"),
        "x1": parse(inner),
        "x2": parse(outer),
        "k": parse(k),
        "Omega": _formula("(k1*k2)^(1/4)"),
        "kappa": _formula("sqrt(k1/k2)"),
        "m": _formula(f"1/2 - (k1 + k2 {bent})/(4*Omega^2)"),
        "period": _formula(f"{4 if ends == ('rest', 'rest') else 8}*K/Omega"),
    }


_KINDS = (("pole", "equator"), ("pole", "rest"), ("rest", "equator"), ("rest", "rest"))


def _roots(a1: Fraction, b1: Fraction, c1: Fraction, nu: Fraction) -> list[str]:
    """Return the roots of P as formulas."""
    if c1 == 0:
        return [f"{-2 * b1 / (nu * nu * a1)}"] if a1 else []
    discriminant = a1 * a1 - 16 * b1 * c1 / (nu * nu)
    if discriminant < 0:
        return []
    return [f"({-a1} {sign} sqrt({discriminant}))/({4 * c1})" for sign in "+-"]


def _nearest(roots: list[str], value: float) -> str | None:
    """Return the root that the turning point is, None if it is none or two are too close to tell."""
    target = Fraction(value)
    with ctx.workprec(_BITS):
        near = [
            root
            for root in roots
            if abs(_ball(root) - _exact(target)) < _exact(_TURNING_POINT_DISTANCE * (1 + target))
        ]
    return near[0] if len(near) == 1 else None


def _cofactor(
    body: RigidBody, a1: Fraction, c1: Fraction, nu: Fraction, inner: str, ends: tuple[str, ...]
) -> tuple[str, Fraction]:
    """Return k, with ``x`` and ``x1``, and its coefficient of x²."""
    factor = 2 / body.C
    if ends[1] == "rest":
        return f"{_factor(2 * factor * c1)}(1 - {_factor(nu)}x - x^2)", -2 * factor * c1
    # The other root of 1 − x² − ν x is −1/xE = −(ν + sqrt(ν² + 4))/2.
    other = f"(x + ({nu} + sqrt({nu * nu + 4}))/2)"
    if c1 == 0:
        return f"{_factor(-factor * a1)}{other}", Fraction(0)
    both = "x" if inner == "0" else "(x1 + x)"
    return f"{_factor(factor)}({-a1} - {_factor(2 * c1)}{both})*{other}", -2 * factor * c1


def _factor(value: Fraction) -> str:
    """Return a number as a factor, nothing if it is 1."""
    return "" if value == 1 else f"({value})*"


def _formula(text: str) -> Tree:
    """Return the tree of a text in which some letters stand for values of functions."""

    def build(_: int, node: Tree, parts: Sequence[Tree]) -> Tree:
        match node:
            case Symbol(name):
                return Symbol(_MEANT.get(name, name))
            case Negation():
                return Negation(parts[0])
            case Call(function):
                return Call(function, parts[0])
            case Binary(operator):
                return Binary(operator, parts[0], parts[1])
        return node

    return fold_tree(parse(text), build)


def _ball(formula: str) -> arb:
    return compile_tape(parse(formula), ()).evaluate(BallAlgebra(), ())


def _exact(value: Fraction) -> arb:
    return BallAlgebra().constant(value)


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
            case Binary("^", Symbol("g2" | "g3" as name), exponent) if (
                n := whole_number(exponent)
            ) is not None:
                return power_of(name, n)
        return with_operands(node, operands)

    return fold_tree(V, build)


def _power(base: Tree, exponent: Fraction) -> Tree:
    return base if exponent == 1 else Binary("^", base, exact_tree(exponent))


def _product(number: Fraction, *factors: Tree) -> Tree:
    first, *rest = factors if number == 1 else (exact_tree(number), *factors)
    for factor in rest:
        first = Binary("*", first, factor)
    return first
