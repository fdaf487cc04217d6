"""A function F(w) of the curve, and its derivatives along θ = w d/dw, by which V1 scales."""

from dataclasses import dataclass
from functools import cache
from typing import TypeVar

from flint import acb, arb

from service.dynamics.formula.algebra import Algebra
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.complex_ball import ComplexBallAlgebra
from service.dynamics.formula.algebras.jets import FirstOrderJets, SecondOrderJets
from service.dynamics.formula.algebras.real import FloatArray, RealAlgebra
from service.dynamics.formula.tape import Tape

T = TypeVar("T")

_Algebras = tuple[Algebra[T], FirstOrderJets[T], SecondOrderJets[T]]


@dataclass(frozen=True, slots=True)
class CurveFunction:
    """F(w) by a tape over the one variable w; each method returns (F, θF, θ²F) up to ``order`` ≤ 2."""

    tape: Tape

    def real(self, w: FloatArray, order: int) -> tuple[FloatArray, ...]:
        """Return doubles; the parts may have fewer axes than ``w`` where they are constant."""
        return self._powers(_real(), w, order)

    def ball(self, w: arb, order: int) -> tuple[arb, ...]:
        """Return enclosures, NaN where F is undefined."""
        return self._powers(_ball(), w, order)

    def complex_ball(self, w: acb, order: int, *, analytic: bool) -> tuple[acb, ...]:
        """Return enclosures of the continuation to complex w; see ComplexBallAlgebra for ``analytic``."""
        return self._powers(_complex(analytic), w, order)

    def _powers(self, algebras: _Algebras[T], w: T, order: int) -> tuple[T, ...]:
        base, first, second = algebras
        if order == 0:
            return (self.tape.evaluate(base, (w,)),)
        if order == 1:
            jet = self.tape.evaluate(first, first.variables((w,)))
            return jet.value, base.multiply(w, first.gradient(jet)[0])
        jet = self.tape.evaluate(second, second.variables((w,)))
        slope, curvature = second.gradient(jet)[0], second.hessian(jet)[0][0]
        # θ²F = w (F' + w F'').
        bent = base.add(slope, base.multiply(w, curvature))
        return jet.value, base.multiply(w, slope), base.multiply(w, bent)


def _with_jets(base: Algebra[T]) -> _Algebras[T]:
    return base, FirstOrderJets(base, 1), SecondOrderJets(base, 1)


@cache
def _real() -> _Algebras[FloatArray]:
    return _with_jets(RealAlgebra())


@cache
def _ball() -> _Algebras[arb]:
    return _with_jets(BallAlgebra())


@cache
def _complex(analytic: bool) -> _Algebras[acb]:
    return _with_jets(ComplexBallAlgebra(analytic=analytic))
