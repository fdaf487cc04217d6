"""Integrates by heyoka's Taylor method: the power series of the solution, step by step.

heyoka turns the equations into machine code that computes the Taylor
coefficients of all six variables, of an order that follows from the tolerance
(22 at 1e-18), and takes steps of ρ/e², ρ the radius of convergence (Jorba & Zou
2005). The code is made in compact form and unoptimised: 0.03 s instead of 0.25 s
for the largest formulas, at three times the price of a step, which pays up to
some ten thousand steps. It is no part of the product, whose own kernels integrate: a rival and a witness.
"""

from collections import deque
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from math import comb, copysign, inf
from typing import Any, Protocol, Self

import heyoka
import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.real import nearest_double
from service.dynamics.formula.tape import Tape
from service.dynamics.potentials.potential import FormulaPotential, NoClosedFormError, Potential
from workers.solvers.errors import UndefinedStartError, UnsupportedFormulaError
from workers.solvers.integration.interface import (
    Rounding,
    Run,
    collapse,
    neighbour_of,
    rounded_moments,
    stacked,
    step_has_collapsed,
    too_many_steps,
)

FloatArray = NDArray[np.float64]

_CHUNK = 512  # steps converted to Chebyshev series at once


class Expression(Protocol):
    """What is used of heyoka's expressions."""

    def __add__(self, other: Self) -> Self: ...
    def __sub__(self, other: Self) -> Self: ...
    def __mul__(self, other: Self) -> Self: ...
    def __truediv__(self, other: Self) -> Self: ...
    def __neg__(self) -> Self: ...
    def __pow__(self, other: float) -> Self: ...


class HeyokaAlgebra:
    """Formulas evaluated in heyoka's expressions, with constants made doubles by ``rounding``."""

    def __init__(self, rounding: Rounding) -> None:
        self._rounding = rounding

    def constant(self, value: Fraction) -> Expression:
        """Return a double."""
        return _constant(self._rounding(value))

    def pi(self) -> Expression:
        """Return π to double precision."""
        return _constant(np.pi)

    def add(self, x: Expression, y: Expression) -> Expression:
        """Return x + y."""
        return x + y

    def subtract(self, x: Expression, y: Expression) -> Expression:
        """Return x − y."""
        return x - y

    def multiply(self, x: Expression, y: Expression) -> Expression:
        """Return x y."""
        return x * y

    def divide(self, x: Expression, y: Expression) -> Expression:
        """Return x / y."""
        return x / y

    def negate(self, x: Expression) -> Expression:
        """Return −x."""
        return -x

    def power(self, x: Expression, exponent: Fraction) -> Expression:
        """Return x^exponent, by products where the exponent is an integer.

        heyoka's own power divides by its base in the recurrence for the Taylor
        coefficients: g2^3 would be undefined on the equator g2 = 0.
        """
        if exponent.denominator != 1:
            return x ** self._rounding(exponent)
        product = _integer_power(x, abs(exponent.numerator))
        return product if exponent >= 0 else _constant(1.0) / product

    def general_power(self, x: Expression, y: Expression) -> Expression:
        """Return exp(y log x)."""
        return self.call("exp", y * self.call("log", x))

    def call(self, name: str, x: Expression) -> Expression:
        """Return the function ``name`` of x; ``abs`` has no Taylor series at 0 and is refused."""
        functions = {
            "sqrt": heyoka.sqrt,
            "exp": heyoka.exp,
            "log": heyoka.log,
            "sin": heyoka.sin,
            "cos": heyoka.cos,
            "tan": heyoka.tan,
        }
        if name not in functions:
            raise UnsupportedFormulaError(
                f"the Taylor integrator has no {name!r}, only {', '.join(functions)}; "
                "the Runge-Kutta integrator takes it",
                pointer="/potential",
            )
        value: Expression = functions[name](x)
        return value


class HeyokaIntegrator:
    """The six equations as a heyoka integrator."""

    name = "heyoka"
    finest = 1e-20
    coarsest = 1e-6
    leaves_out = 0.2  # the terms after the last one, of steps of 0.15 of the radius
    first_share = 0.01
    tightening = 100.0  # two orders: two tolerances within one order would take the same steps

    def __init__(self, body: RigidBody, potential: Potential, rounding: Rounding = nearest_double) -> None:
        """Build the right-hand sides; raises MissingMomentError, UnsupportedFormulaError."""
        self._body, self._potential = body, potential
        self._equations = _equations(rounded_moments(body, rounding), potential, rounding)
        self._steppers: dict[float, Any] = {}  # heyoka's integrators by their tolerance; it has no types
        self._neighbour: HeyokaIntegrator | None = None

    def neighbour(self) -> "HeyokaIntegrator":
        """See Integrator.neighbour."""
        if self._neighbour is None:
            self._neighbour = HeyokaIntegrator(self._body, self._potential, neighbour_of)
        return self._neighbour

    def run(
        self,
        state: FloatArray,
        end: float,
        *,
        local_tolerance: float,
        max_steps: int,
        longest: float = inf,
        since: float = 0.0,
    ) -> Run:
        """Integrate from ``state`` to ``end``; see Integrator.run."""
        start_gradient = self._potential.gradient(state[3:])
        if not np.isfinite(start_gradient).all():
            return Run(np.zeros(1), np.zeros((0, 1, 6)), UndefinedStartError())
        stepper = self._stepper(state, local_tolerance)
        breaks, steps = [0.0], list[float]()
        series, converted = list[FloatArray](), list[FloatArray]()
        visited = deque([state[3:]], maxlen=2)
        longest_taken, has_failed = 0.0, False
        while breaks[-1] != end and len(breaks) <= max_steps:
            left = end - breaks[-1]
            limit = left if abs(left) <= longest else copysign(longest, left)
            outcome, step = stepper.step(max_delta_t=limit, write_tc=True)
            is_cut = outcome == heyoka.taylor_outcome.time_limit
            at_end = is_cut and limit == left
            has_failed = outcome == heyoka.taylor_outcome.err_nf_state
            if not has_failed:
                longest_taken = max(longest_taken, abs(step))
                has_failed = not is_cut and step_has_collapsed(step, longest_taken, breaks[-1])
            if has_failed:
                break
            breaks.append(end if at_end else float(stepper.time))
            visited.append(stepper.state[3:].copy())
            steps.append(step)
            series.append(stepper.tc.copy())
            if len(series) == _CHUNK:
                converted.append(_chebyshev(np.array(series), np.array(steps)))
                series, steps = [], []
        if series:
            converted.append(_chebyshev(np.array(series), np.array(steps)))
        run = Run(np.array(breaks), stacked(converted), None)
        end_gradient = self._potential.gradient(visited[-1])
        if not np.isfinite(end_gradient).all():
            # Where the potential is hardly less than smooth, a step can end beyond its domain.
            end_gradient, has_failed = self._potential.gradient(visited[0]), True
            run = Run(run.breaks[:-1], run.coefficients[:-1], None)
        if has_failed:
            return replace(run, ending=collapse(since + run.reached, start_gradient, end_gradient))
        if run.reached != end:
            return replace(run, ending=too_many_steps(since + run.reached, since + end, max_steps))
        return run

    def keeps(self, run: Run, goal: float, allowed: float) -> bool:
        """See Integrator.keeps; nothing is known here."""
        return False

    def _stepper(self, state: FloatArray, local_tolerance: float) -> Any:  # noqa: ANN401
        """Return heyoka's integrator at ``state`` and t = 0; its machine code is made once."""
        stepper = self._steppers.get(local_tolerance)
        if stepper is None:
            stepper = self._steppers[local_tolerance] = heyoka.taylor_adaptive(
                self._equations,
                state.tolist(),
                tol=local_tolerance,
                high_accuracy=True,
                compact_mode=True,
                opt_level=0,
                parjit=False,
            )
        stepper.time = 0.0
        stepper.state[:] = state
        return stepper


@lru_cache(maxsize=4)
def heyoka_integrator(body: RigidBody, potential: FormulaPotential) -> HeyokaIntegrator:
    """Return the integrator of the equations; raises what :class:`HeyokaIntegrator` does.

    Motions of one body in one potential share it: its machine code takes longer to make than to run.
    """
    return HeyokaIntegrator(body, potential)


class _Maker(str):
    """Its name, where the product's integrators have theirs; called, it makes the integrator."""

    __slots__ = ()

    def __call__(self, body: RigidBody, potential: Potential) -> HeyokaIntegrator:
        if isinstance(potential, FormulaPotential):
            return heyoka_integrator(body, potential)
        return HeyokaIntegrator(body, potential)


HEYOKA = _Maker("heyoka")


def _equations(
    moments: FloatArray, potential: Potential, rounding: Rounding
) -> list[tuple[Expression, Expression]]:
    """Return the Euler-Poisson equations, (variable, its derivative) for the six variables."""
    p, q, r, g1, g2, g3 = heyoka.make_vars("p", "q", "r", "g1", "g2", "g3")
    V = _tape(potential).evaluate(HeyokaAlgebra(rounding), (g1, g2, g3))
    V1, V2, V3 = heyoka.diff_tensors([V], [g1, g2, g3]).gradient
    A, B, C, *_ = moments.tolist()
    return [
        (p, ((B - C) * (q * r) + (g2 * V3 - g3 * V2)) / A),
        (q, ((C - A) * (p * r) + (g3 * V1 - g1 * V3)) / B),
        (r, ((A - B) * (p * q) + (g1 * V2 - g2 * V1)) / C),
        (g1, r * g2 - q * g3),
        (g2, p * g3 - r * g1),
        (g3, q * g1 - p * g2),
    ]


def _tape(potential: Potential) -> Tape:
    try:
        return potential.tape
    except NoClosedFormError as error:
        raise UnsupportedFormulaError(
            "the Taylor integrator needs a formula, and this potential is given by an integral; "
            "the Runge-Kutta integrator takes it",
            pointer=error.pointer,
        ) from error


def _constant(value: float) -> Expression:
    expression: Expression = heyoka.expression(value)
    return expression


def _integer_power(x: Expression, exponent: int) -> Expression:
    product = None
    while exponent:
        if exponent & 1:
            product = x if product is None else product * x
        exponent >>= 1
        x = x * x if exponent else x
    return _constant(1.0) if product is None else product


def _chebyshev(series: FloatArray, steps: FloatArray) -> FloatArray:
    r"""Return the Chebyshev series of Taylor polynomials, each over its own step.

    With u = τ/h in [0, 1] and x = 2u − 1,

    .. math:: u^k = 2^{1-2k} \sum_{j=0}^{k}{}' \binom{2k}{k-j} T_j(x) ,

    all terms positive with the sum 1: the conversion loses nothing.

    Parameters
    ----------
    series
        Taylor coefficients, shape (steps, 6, order + 1).
    steps
        Lengths h with their sign, shape (steps,).
    """
    order = series.shape[2] - 1
    scaled = series * steps[:, None, None] ** np.arange(order + 1)
    matrix = np.array(
        [
            [comb(2 * k, k - j) / 4**k * (1 if j == 0 else 2) if j <= k else 0.0 for j in range(order + 1)]
            for k in range(order + 1)
        ]
    )
    return trimmed(np.swapaxes(scaled @ matrix, 1, 2))


def trimmed(coefficients: FloatArray) -> FloatArray:
    """Drop the trailing coefficients that no double can see: 2^-54 of the largest, column by column."""
    size = np.abs(coefficients).max(axis=0)
    tail = np.cumsum(size[::-1], axis=0)[::-1]
    visible = (~(tail <= 2.0**-54 * size.max(axis=0))).any(axis=1)
    length = max(1, int(np.flatnonzero(visible)[-1]) + 1) if visible.any() else 1
    return coefficients[:, :length]
