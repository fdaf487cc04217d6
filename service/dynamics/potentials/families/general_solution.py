r"""Evaluates the general admissible potential V = V1[F] + Q G(g2) in doubles and balls.

H. M. Yehia's theorem: on the sphere every V with L(V) = 0 is of this form on
each of the four quadrants (signs of g1 and g3), with Q = A g1² + C g3² and V1
the integral of :mod:`.angular_part`. The curves do not leave their quadrant, so F
and G may differ from one to the next. The energy of the motion on a curve is
−F(w).
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Literal, get_args

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.formula.tape import Tape
from service.dynamics.formula.tree import Tree, format_tree
from service.dynamics.potentials.angular_part.along_curve import CurveField, LoopCurve
from service.dynamics.potentials.angular_part.balls import powers_of
from service.dynamics.potentials.angular_part.field import AngularField
from service.dynamics.potentials.potential import (
    BallJet,
    BallRow,
    FormulaPotential,
    NoClosedFormError,
    Notice,
    Potential,
)

FloatArray = NDArray[np.float64]

FAMILY = "general"
Quadrant = Literal["pp", "mp", "pm", "mm"]
"""The signs of g1 and g3, plus or minus."""
QUADRANTS: tuple[Quadrant, ...] = get_args(Quadrant)
SIGNS: dict[Quadrant, tuple[int, int]] = {"pp": (1, 1), "mp": (-1, 1), "pm": (1, -1), "mm": (-1, -1)}
INTEGRAL_BITS = (160, 640)
"""Bits to which V1 is computed, in turn, where the caller has more: 1 − g2 in G loses 1400 bits next to a
pole, V1 none, and an integral to 2560 bits takes a minute."""
MIN_KNOWN_BITS = 64
"""Bits of D below which a value along a curve is that of the integral."""


@dataclass(frozen=True, slots=True)
class Piece:
    """The potential on one quadrant: V1[F] and the formula potential Q G."""

    angular: AngularField
    even: FormulaPotential
    F: Tree = field(compare=False, repr=False)
    G: Tree = field(compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class GeneralPotential(Potential):
    """V1[F] + Q G(g2), with one piece for each of QUADRANTS.

    With one piece on all quadrants V is even in g1 and in g3; otherwise it is
    NaN where g1 g3 = 0.
    """

    pieces: tuple[Piece, Piece, Piece, Piece] = field(repr=False)
    reference_angle: Tree

    @property
    def family(self) -> str:
        """See Potential.family."""
        return FAMILY

    @property
    def notices(self) -> tuple[Notice, ...]:
        """See Potential.notices: none."""
        return ()

    @property
    def tree(self) -> Tree:
        """Raise NoClosedFormError."""
        raise self._no_closed_form()

    @property
    def tape(self) -> Tape:
        """Raise NoClosedFormError."""
        raise self._no_closed_form()

    @property
    def is_uniform(self) -> bool:
        """Whether the same F and G hold on all quadrants."""
        return all(piece == self.pieces[0] for piece in self.pieces)

    def piece(self, g1_sign: int, g3_sign: int) -> Piece:
        """Return the piece on the quadrant of these signs, ±1."""
        return self.pieces[(g1_sign < 0) + 2 * (g3_sign < 0)]

    def formula_part(self, g1_sign: int, g3_sign: int) -> FormulaPotential:
        """See Potential.formula_part: Q G."""
        return self.piece(g1_sign, g3_sign).even

    def powers_of_w(self, g1_sign: int, g3_sign: int) -> tuple[Fraction, ...]:
        """See Potential.powers_of_w."""
        angular = self.piece(g1_sign, g3_sign).angular
        return tuple(powers_of(angular.F.tape, angular.body.alpha) or ())

    def formula(self) -> str:
        """Return V as text, with ``V1[F; φ0]`` for the integral."""
        angle = format_tree(self.reference_angle)
        texts = [f"V1[{format_tree(p.F)}; {angle}] + {p.even.formula()}" for p in self.pieces]
        if self.is_uniform:
            return texts[0]
        return ", ".join(f"{quadrant}: {text}" for quadrant, text in zip(QUADRANTS, texts, strict=True))

    def value(self, gamma: FloatArray) -> FloatArray:
        """See Potential.value."""

        def value(piece: Piece, gamma: FloatArray) -> FloatArray:
            return piece.angular.real(gamma[:, 0], gamma[:, 2], 0).value + piece.even.value(gamma)

        return self._by_quadrant(value, gamma, ())

    def gradient(self, gamma: FloatArray) -> FloatArray:
        """See Potential.gradient."""

        def gradient(piece: Piece, gamma: FloatArray) -> FloatArray:
            jet = piece.angular.real(gamma[:, 0], gamma[:, 2], 1)
            return _filled(jet.gradient, len(gamma)) + piece.even.gradient(gamma)

        return self._by_quadrant(gradient, gamma, (3,))

    def gradient_at(self, g1: float, g2: float, g3: float) -> tuple[float, float, float]:
        """See Potential.gradient_at."""
        piece = self._piece_at(g1, g3)
        if piece is None:
            return np.nan, np.nan, np.nan
        first, _, third = piece.angular.real(np.array([g1]), np.array([g3]), 1).gradient
        V_1, V_2, V_3 = piece.even.gradient_at(g1, g2, g3)
        return V_1 + float(first[0]), V_2, V_3 + float(third[0])

    def hessian(self, gamma: FloatArray) -> FloatArray:
        """See Potential.hessian."""

        def hessian(piece: Piece, gamma: FloatArray) -> FloatArray:
            rows = piece.angular.real(gamma[:, 0], gamma[:, 2], 2).hessian
            return np.stack([_filled(row, len(gamma)) for row in rows], axis=1) + piece.even.hessian(gamma)

        return self._by_quadrant(hessian, gamma, (3, 3))

    def value_and_D(self, g1: FloatArray, g2: FloatArray, g3: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See Potential.value_and_D."""

        def both(piece: Piece, gamma: FloatArray) -> FloatArray:
            jet = piece.angular.real(gamma[:, 0], gamma[:, 2], 0)
            value, D = piece.even.value_and_D(*gamma.T)
            return np.stack([jet.value + value, jet.D + D], axis=1)

        result = self._by_quadrant(both, np.stack([g1, g2, g3], axis=-1), (2,))
        return result[..., 0], result[..., 1]

    def value_ball(self, g1: arb, g2: arb, g3: arb) -> arb:
        """See Potential.value_ball."""
        piece = self._piece_at(g1, g3)
        if piece is None:
            return arb("nan")
        value = piece.even.value_ball(g1, g2, g3)
        # The integral takes a thousand times as long: where the formula has no value it is not asked.
        return piece.angular.ball(g1, g3, 0).value + value if value.is_finite() else value

    def value_and_D_ball(self, g1: arb, g2: arb, g3: arb) -> tuple[arb, arb]:
        """See Potential.value_and_D_ball."""
        piece = self._piece_at(g1, g3)
        if piece is None:
            return arb("nan"), arb("nan")
        value, D = piece.even.value_and_D_ball(g1, g2, g3)
        if not (value.is_finite() and D.is_finite()):
            return value, D
        for bits in INTEGRAL_BITS if ctx.prec > INTEGRAL_BITS[-1] else (ctx.prec,):
            with ctx.workprec(bits):
                jet = piece.angular.ball(g1, g3, 0)
            total = jet.D + D
            if total.rel_accuracy_bits() >= MIN_KNOWN_BITS or jet.D.rad() <= D.rad():
                break
        return jet.value + value, total

    def jet_ball(self, g1: arb, g2: arb, g3: arb) -> BallJet:
        """See Potential.jet_ball."""
        piece = self._piece_at(g1, g3)
        if piece is None:
            nan = arb("nan")
            row = (nan, nan, nan)
            return nan, row, (row, row, row)
        jet = piece.angular.ball(g1, g3, 2)
        value, gradient, hessian = piece.even.jet_ball(g1, g2, g3)
        first, second, third = (_sum(*rows) for rows in zip(jet.hessian, hessian, strict=True))
        return jet.value + value, _sum(jet.gradient, gradient), (first, second, third)

    def _by_quadrant(
        self, function: Callable[[Piece, FloatArray], FloatArray], gamma: FloatArray, shape: tuple[int, ...]
    ) -> FloatArray:
        """Return ``function`` of the piece and the points (n, 3) of each quadrant, put together."""
        gamma = np.asarray(gamma, dtype=np.float64)
        points = gamma.reshape(-1, 3)
        if self.is_uniform:
            result = function(self.pieces[0], points)
        else:
            result = np.full((len(points), *shape), np.nan)
            g1, g3 = points[:, 0], points[:, 2]
            for first in (1, -1):
                for third in (1, -1):
                    inside = (first * g1 > 0.0) & (third * g3 > 0.0)
                    if inside.any():
                        result[inside] = function(self.piece(first, third), points[inside])
        return result.reshape((*gamma.shape[:-1], *shape))

    def _piece_at(self, g1: arb | float, g3: arb | float) -> Piece | None:
        """Return the piece at a point or ball, None if its quadrant is not certain."""
        if self.is_uniform:
            return self.pieces[0]
        signs = [1 if g > 0 else -1 if g < 0 else 0 for g in (g1, g3)]
        return self.piece(signs[0], signs[1]) if all(signs) else None

    def _no_closed_form(self) -> NoClosedFormError:
        return NoClosedFormError(
            "the potential is given by an integral and has no formula", pointer="/potential"
        )


@dataclass(frozen=True, slots=True)
class AlongCurve(GeneralPotential):
    """The potential at places of one curve, in balls that are estimates where V1 is a series."""

    exact: GeneralPotential = field(repr=False)

    def value_and_D_ball(self, g1: arb, g2: arb, g3: arb) -> tuple[arb, arb]:
        """See Potential.value_and_D_ball; next to a rest, where D vanishes, V1 is an integral."""
        value, D = GeneralPotential.value_and_D_ball(self, g1, g2, g3)
        return (
            (value, D) if D.rel_accuracy_bits() >= MIN_KNOWN_BITS else self.exact.value_and_D_ball(g1, g2, g3)
        )


def along_curve(potential: GeneralPotential, curve: LoopCurve) -> AlongCurve:
    """Return the potential for many places of one curve."""
    first, second, third, fourth = (
        replace(piece, angular=CurveField(angular.body, angular.F, angular.reference_angle, curve))
        for piece in potential.pieces
        for angular in (piece.angular,)
    )
    return AlongCurve((first, second, third, fourth), potential.reference_angle, potential)


def _filled(row: tuple[FloatArray, FloatArray, FloatArray], count: int) -> FloatArray:
    return np.stack([np.broadcast_to(part, (count,)) for part in row], axis=-1)


def _sum(left: BallRow, right: BallRow) -> BallRow:
    return left[0] + right[0], left[1] + right[1], left[2] + right[2]
