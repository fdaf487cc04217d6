r"""The coordinate φ at a pole, in which everything is smooth on one side of it.

About the pole v = πk, with u = |v − πk| and a whole number n, the unit,

.. math:: \tan\frac u2 = \tan^n\frac\varphi2,\qquad \frac{du}{d\varphi} = n\,\frac{\sin u}{\sin\varphi},

.. math:: |\sin v| = \frac{2X}{1+X^2},\quad X = \tan^n\frac\varphi2 .

So |sin v|^(1/n) is holomorphic about φ = 0 as well as between the poles, and with it |g1| = G |sin v|^α and
all powers of it if n is a multiple of their denominators: then V, p and time are. From a pole to the equator
φ runs from 0 to π/2, whatever n is, and where n is large the pieces of it that an analytic function takes
grow in number like log n.
"""

from dataclasses import dataclass
from fractions import Fraction
from math import lcm

from flint import acb, arb

from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.power_sums import Power, PowerAlgebra, PowerSum, Small
from service.dynamics.formula.tape import Tape
from service.dynamics.reduction.geometry.loop import Loop
from workers.solvers.complex_plane.complex_loop import ComplexLoop, ComplexPlace

GENERIC_ROOT_OF_SINE = Fraction(2, 3)
"""A value of |sin v|^(1/unit) at which a formula is asked for its powers."""


def unit_at_poles(loop: Loop, tape: Tape) -> int:
    """Return the least n in which all powers of |sin v| in V and on the curve are whole powers.

    0 if n = 1 serves on both sides of a pole at once: V is a function of sin v there.
    """
    base, denominator = BallAlgebra(), loop.alpha.denominator
    number = base.constant(GENERIC_ROOT_OF_SINE)
    drop = PowerSum({(Fraction(2), 0): number})
    asked: set[Power] = set()
    for pole in (1, -1):
        algebra = PowerAlgebra(base, Small(number, denominator, 1))
        g1, g3 = algebra.loop(loop.G, loop.Z, loop.alpha, loop.g1_sign)
        g2 = algebra.subtract(algebra.constant(Fraction(1)), drop)
        g2 = g2 if pole > 0 else algebra.negate(g2)
        algebra.value(tape.evaluate(algebra, (g3, g2, g1) if loop.mirrored else (g1, g2, g3)))
        asked |= algebra.powers
    whole = Small(number, 1, 0)
    if denominator == 1 and all(whole.power_of_root(power) is not None for power in asked):
        return 0
    return lcm(denominator, *(exponent.denominator for exponent, _ in asked))


def drops_matter(tape: Tape) -> bool:
    """Say whether a formula may take a root or a logarithm of 1 − |g2|, which g2 does not tell well."""
    return any(
        made.operation == "general_power"
        or (made.operation == "call" and made.name == "log")
        or (made.operation == "power" and made.number is not None and made.number.denominator != 1)
        for made in tape.instructions
    )


@dataclass(frozen=True, slots=True)
class Passage:
    """One side of the pole v = πk."""

    curve: ComplexLoop
    """Its side is the sign of sin v here, and its unit n."""
    pole: int
    """k."""
    way: int
    """The sign of v − πk."""

    def place(self, phi: acb, *, analytic: bool) -> tuple[ComplexPlace, acb]:
        """Return the place at φ, and du/dφ; not finite if ``analytic`` and not holomorphic on the ball."""
        curve, loop = self.curve, self.curve.loop
        n, side = curve.unit, curve.side
        cosine, tangent = (phi / 2).cos(), (phi / 2).tan()
        below = _raised(tangent, n - 1)
        X = below * tangent
        square = X * X
        total = 1 + square
        slope = n * below / (cosine * cosine * total)
        root = tangent * ((2 / total).log(analytic) / n).exp()
        whole = loop.alpha * n
        quotient = (1 - _raised(root, 2 * whole.numerator)) / (1 - _raised(root, 2 * n))
        c_squared = loop.Z * loop.Z + loop.G * loop.G * quotient
        at = ComplexPlace(
            sine=side * 2 * X / total,
            cosine=(-1) ** self.pole * (1 - square) / total,
            power=_raised(root, whole.numerator - n),
            turn=acb(side),
            c_squared=c_squared,
            c=curve.root_of(c_squared, analytic),
            root=root,
        )
        return at, slope

    def angle(self, phi: acb) -> acb:
        """Return v at φ."""
        return acb.pi() * self.pole + self.way * 2 * _raised((phi / 2).tan(), self.curve.unit).atan()

    def log_sigma(self, phi: arb) -> arb:
        """Return log |sin v| at a real φ."""
        X = (phi / 2).tan() ** self.curve.unit
        return (2 * X / (1 + X * X)).log()

    def phase(self, v: arb) -> arb:
        """Return φ at a real v on this side; not finite elsewhere."""
        tangent = ((v - arb.pi() * self.pole) * self.way / 2).tan()
        return 2 * (tangent.log() / self.curve.unit).exp().atan() if tangent > 0 else arb.nan()


def _raised(base: acb, exponent: int) -> acb:
    """Return a whole power; by logarithms, which keep wide balls narrower, where their branch is certain."""
    return (exponent * base.log()).exp() if base.real > 0 else base**exponent
