"""The interface of a potential: value and derivatives in the Poisson variables, in doubles and balls.

The ways in which a potential is often evaluated in balls are programs (:class:`Way`); a valid potential
with a surprising property comes with notices.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.formula import derived
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.jets import FirstOrderJets, SecondOrderJets
from service.dynamics.formula.algebras.real import QuietedRealAlgebra, RealAlgebra, ScalarAlgebra
from service.dynamics.formula.derived import Derivation
from service.dynamics.formula.programs import MANY_EVALUATIONS, Traced, Tracer, Way
from service.dynamics.formula.tape import Tape, compile_tape
from service.dynamics.formula.tree import VARIABLES, Tree, format_tree

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Notice:
    """A warning: a stable ``code``, a sentence, and the place of the field (a JSON pointer)."""

    code: str
    message: str
    pointer: str


def _way(derivation: Derivation, often: int = MANY_EVALUATIONS) -> Way:
    def trace(tape: Tape, tracer: Tracer) -> tuple[Sequence[Traced], Sequence[Traced]]:
        inputs = [tracer.variable(name) for name in VARIABLES]
        return inputs, derivation(tape, tracer, inputs)

    return Way("real", trace, is_shared=True, often=often)


VALUE, TURN, VALUE_AND_TURN = _way(derived.value), _way(derived.turn), _way(derived.value_and_turn)
SECOND_ORDER = _way(derived.second_order, often=3 * MANY_EVALUATIONS)
"""A long program."""


BallRow = tuple[arb, arb, arb]
BallJet = tuple[arb, BallRow, tuple[BallRow, BallRow, BallRow]]
"""Value, gradient and hessian."""


class NoClosedFormError(DynamicsError):
    """The potential is given by an integral and has no formula."""

    code = "no_closed_form"


class Potential(ABC):
    """V(g1, g2, g3). Where V is undefined, values in doubles and balls are NaN."""

    __slots__ = ()

    @property
    @abstractmethod
    def family(self) -> str:
        """Return the name of the family it was stated in."""

    @property
    @abstractmethod
    def notices(self) -> tuple[Notice, ...]:
        """Return what the client should know about the way the potential was made."""

    @property
    @abstractmethod
    def tree(self) -> Tree:
        """Return V as a tree of g1, g2, g3, pi and numbers; raises NoClosedFormError."""

    @property
    @abstractmethod
    def tape(self) -> Tape:
        """Return V as a tape over g1, g2, g3; raises NoClosedFormError."""

    @property
    def as_stated(self) -> "Potential":
        """Return the potential by the formula that was typed: what a verdict is about."""
        return self

    @property
    def has_formula(self) -> bool:
        """Tell whether there is a tape."""
        try:
            return len(self.tape.variables) > 0
        except NoClosedFormError:
            return False

    def formula_part(self, g1_sign: int, g3_sign: int) -> "FormulaPotential | None":
        """Return the part that has a formula on a quadrant, of a potential that as a whole has none."""
        return None

    def powers_of_w(self, g1_sign: int, g3_sign: int) -> tuple[Fraction, ...]:
        """Return the exponents of F, if that is a sum of powers of w on a quadrant and V has no formula."""
        return ()

    @abstractmethod
    def formula(self) -> str:
        """Return V as a formula of the grammar, or as one with an integral if it has no closed form."""

    @abstractmethod
    def value(self, gamma: FloatArray) -> FloatArray:
        """Return V at ``gamma`` of shape (..., 3), shape (...)."""

    @abstractmethod
    def gradient(self, gamma: FloatArray) -> FloatArray:
        """Return (V_1, V_2, V_3) at ``gamma`` of shape (..., 3), same shape."""

    @abstractmethod
    def gradient_at(self, g1: float, g2: float, g3: float) -> tuple[float, float, float]:
        """Return (V_1, V_2, V_3) at one point, in plain floats: for integrators."""

    @abstractmethod
    def hessian(self, gamma: FloatArray) -> FloatArray:
        """Return the second derivatives V_ij at ``gamma`` of shape (..., 3), shape (..., 3, 3)."""

    @abstractmethod
    def value_and_D(self, g1: FloatArray, g2: FloatArray, g3: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return V and D = g1 V_3 - g3 V_1 at the points given by three arrays of one shape, same shape."""

    @abstractmethod
    def value_ball(self, g1: arb, g2: arb, g3: arb) -> arb:
        """Return an enclosure of V, at the current ``flint.ctx.prec``."""

    def value_balls(self, points: Iterable[Sequence[float]]) -> list[arb]:
        """Return what :meth:`value_ball` does at each of many points (g1, g2, g3) in doubles."""
        return [self.value_ball(arb(g1), arb(g2), arb(g3)) for g1, g2, g3 in points]

    @abstractmethod
    def value_and_D_ball(self, g1: arb, g2: arb, g3: arb) -> tuple[arb, arb]:
        """Return enclosures of V and D."""

    @abstractmethod
    def jet_ball(self, g1: arb, g2: arb, g3: arb) -> BallJet:
        """Return enclosures of V, of (V_1, V_2, V_3) and of the second derivatives V_ij."""

    @staticmethod
    def from_tree(tree: Tree, family: str, notices: tuple[Notice, ...] = ()) -> "FormulaPotential":
        """Return the potential of a bound tree; raises as :func:`compile_tape`."""
        return FormulaPotential(tree, compile_tape(tree), family, notices)

    def D(self, gamma: FloatArray) -> FloatArray:
        """Return D = g1 V_3 - g3 V_1 at ``gamma`` of shape (..., 3), shape (...)."""
        return self.D_real(*_parts(np.asarray(gamma, dtype=np.float64)))

    def D_real(self, g1: FloatArray, g2: FloatArray, g3: FloatArray) -> FloatArray:
        """Return D at the points given by three arrays of one shape, same shape."""
        return self.value_and_D(g1, g2, g3)[1]

    def D_ball(self, g1: arb, g2: arb, g3: arb) -> arb:
        """Return an enclosure of D."""
        return self.value_and_D_ball(g1, g2, g3)[1]

    def H(self, body: RigidBody, gamma: FloatArray) -> FloatArray:
        """Return H = V + Q D / (2 (A - C) g1 g3), Q = A g1² + C g3², shape (...).

        V is admissible if and only if H is constant on every curve
        |g3| = λ |g1|^(C/A); the constant is the energy. NaN where g1 g3 = 0.

        Raises
        ------
        EqualMomentsError
            A = C.
        """
        body.require_planar()
        gamma = np.asarray(gamma, dtype=np.float64)
        g1, g2, g3 = _parts(gamma)
        A, C = float(body.A), float(body.C)
        value, D = self.value_and_D(g1, g2, g3)
        with np.errstate(all="ignore"):
            H = value + (A * g1**2 + C * g3**2) * D / (2.0 * (A - C) * g1 * np.where(g3 == 0.0, np.nan, g3))
        return np.where(np.isfinite(H), H, np.nan)

    def H_ball(self, body: RigidBody, g1: arb, g2: arb, g3: arb) -> arb:
        """Return an enclosure of H; raises as :meth:`H`."""
        body.require_planar()
        ball = BallAlgebra()
        value, D = self.value_and_D_ball(g1, g2, g3)
        Q = ball.constant(body.A) * g1 * g1 + ball.constant(body.C) * g3 * g3
        return value + Q * D / (ball.constant(2 * (body.A - body.C)) * g1 * g3)


@dataclass(frozen=True, slots=True)
class FormulaPotential(Potential):
    """V given by a formula.

    ``tree`` has g1, g2, g3, pi and numbers only. Two potentials are equal if
    their tapes are: what is computed is the same.
    """

    # Each field is declared without a default: otherwise the property of the base class would be its default.
    tree: Tree = field(compare=False, repr=False)
    tape: Tape = field()
    family: str = field()
    notices: tuple[Notice, ...] = field(default=(), compare=False)
    stated: Potential | None = field(default=None, compare=False)
    """The potential as it was stated, where ``tree`` is a simpler formula, equal on the sphere."""

    @property
    def as_stated(self) -> Potential:
        """See Potential.as_stated."""
        return self if self.stated is None else self.stated

    def alone(self) -> "FormulaPotential":
        """Return the same potential with a tape of its own: what is kept beside a tape is for one problem."""
        tape = Tape(self.tape.variables, self.tape.instructions, self.tape.result, self.tape.derived)
        return replace(self, tape=tape)

    def formula(self) -> str:
        """Return V as a formula of the grammar, the one that was typed; see Potential.formula."""
        return format_tree(self.tree) if self.stated is None else self.stated.formula()

    def value(self, gamma: FloatArray) -> FloatArray:
        """See Potential.value."""
        gamma = np.asarray(gamma, dtype=np.float64)
        if gamma.ndim == 1:
            return np.asarray(self.tape.evaluate(ScalarAlgebra(), gamma.tolist()))
        value = self.tape.evaluate(RealAlgebra(), _parts(gamma))
        return np.broadcast_to(value, gamma.shape[:-1]).copy()

    def gradient(self, gamma: FloatArray) -> FloatArray:
        """See Potential.gradient."""
        gamma = np.asarray(gamma, dtype=np.float64)
        if gamma.ndim == 1:
            return np.array(self.gradient_at(*gamma.tolist()))
        jets = _REAL_JETS
        jet = self.tape.evaluate(jets, jets.variables(_parts(gamma)))
        columns = [np.broadcast_to(part, gamma.shape[:-1]) for part in jets.gradient(jet)]
        return np.stack(columns, axis=-1)

    def gradient_at(self, g1: float, g2: float, g3: float) -> tuple[float, float, float]:
        """See Potential.gradient_at."""
        jets = _SCALAR_JETS
        V_1, V_2, V_3 = jets.gradient(self.tape.evaluate(jets, jets.variables((g1, g2, g3))))
        return V_1, V_2, V_3

    def hessian(self, gamma: FloatArray) -> FloatArray:
        """See Potential.hessian."""
        gamma = np.asarray(gamma, dtype=np.float64)
        jets = _REAL_SECOND_JETS
        jet = self.tape.evaluate(jets, jets.variables(_parts(gamma)))
        shape = gamma.shape[:-1]
        rows = [
            np.stack([np.broadcast_to(part, shape) for part in row], axis=-1) for row in jets.hessian(jet)
        ]
        return np.stack(rows, axis=-2)

    def value_and_D(self, g1: FloatArray, g2: FloatArray, g3: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See Potential.value_and_D."""
        jets = _QUIETED_JETS
        # D is the derivative along (-g3, 0, g1): the turn about the second axis.
        inputs = (jets.seed(g1, (-g3,)), jets.seed(g2, (None,)), jets.seed(g3, (g1,)))
        with np.errstate(all="ignore"):
            jet = self.tape.evaluate(jets, inputs)
        shape = np.shape(g1)
        value, D = jet.value, jets.gradient(jet)[0]
        return np.broadcast_to(value, shape).copy(), np.broadcast_to(D, shape).copy()

    def value_ball(self, g1: arb, g2: arb, g3: arb) -> arb:
        """See Potential.value_ball."""
        run = self.tape.program("V", VALUE)
        value: arb = self.tape.evaluate(BallAlgebra(), (g1, g2, g3)) if run is None else run(g1, g2, g3)[0]
        return value

    def value_balls(self, points: Iterable[Sequence[float]]) -> list[arb]:
        """See Potential.value_balls; here the way to ask the formula is looked up once."""
        run, found = None, list[arb]()
        for g1, g2, g3 in points:
            run = run or self.tape.program("V", VALUE)
            place = arb(g1), arb(g2), arb(g3)
            found.append(self.value_ball(*place) if run is None else run(*place)[0])
        return found

    def D_ball(self, g1: arb, g2: arb, g3: arb) -> arb:
        """See Potential.D_ball."""
        run = self.tape.program("D", TURN)
        D: arb = self._value_and_D_ball(g1, g2, g3)[1] if run is None else run(g1, g2, g3)[0]
        return D

    def value_and_D_ball(self, g1: arb, g2: arb, g3: arb) -> tuple[arb, arb]:
        """See Potential.value_and_D_ball."""
        run = self.tape.program("V, D", VALUE_AND_TURN)
        if run is None:
            return self._value_and_D_ball(g1, g2, g3)
        value, D = run(g1, g2, g3)
        return value, D

    def _value_and_D_ball(self, g1: arb, g2: arb, g3: arb) -> tuple[arb, arb]:
        jets = _BALL_JETS
        inputs = (jets.seed(g1, (-g3,)), jets.seed(g2, (None,)), jets.seed(g3, (g1,)))
        jet = self.tape.evaluate(jets, inputs)
        D = jet.first[0]
        return jet.value, arb(0) if D is None else D

    def jet_ball(self, g1: arb, g2: arb, g3: arb) -> BallJet:
        """See Potential.jet_ball."""
        run = self.tape.program("V, gradient, hessian", SECOND_ORDER)
        if run is None:
            jets = _BALL_SECOND_JETS
            jet = self.tape.evaluate(jets, jets.variables((g1, g2, g3)))
            V, (V_1, V_2, V_3) = jet.value, jets.gradient(jet)
            (V_11, V_12, V_13), (_, V_22, V_23), (_, _, V_33) = jets.hessian(jet)
        else:
            V, V_1, V_2, V_3, V_11, V_12, V_13, V_22, V_23, V_33 = run(g1, g2, g3)
        return V, (V_1, V_2, V_3), ((V_11, V_12, V_13), (V_12, V_22, V_23), (V_13, V_23, V_33))


def _parts(gamma: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    return gamma[..., 0], gamma[..., 1], gamma[..., 2]


_REAL_JETS = FirstOrderJets(RealAlgebra(), 3)
_QUIETED_JETS = FirstOrderJets(QuietedRealAlgebra(), 1)
_REAL_SECOND_JETS = SecondOrderJets(RealAlgebra(), 3)
_SCALAR_JETS = FirstOrderJets(ScalarAlgebra(), 3)
_BALL_JETS = FirstOrderJets(BallAlgebra(), 1)
_BALL_SECOND_JETS = SecondOrderJets(BallAlgebra(), 3)
