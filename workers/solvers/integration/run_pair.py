r"""Runs an integration twice; the difference, the residual, and how far errors grow, tell its error.

The second run has a looser local tolerance, hence other steps and other
rounding, and solves a problem that the rounded data (state, moments,
coefficients) might as well have meant. Their difference therefore shows
truncation, rounding and what has become of them. It is one draw: where errors grow,
all of them grow in one direction, in which two runs may be at one place by chance, or lose the
same by the same roundings. So the claim has another part: what errors of every step grow to along the motion
(:mod:`workers.solvers.compiled.general.growth`), J being taken here from equations that any potential has.

Nor does the difference stand alone. What the finer run y leaves of the equations, d = y' − F(y), is known all
along it, and with it, to first order, the very error of y, without any other run:

.. math:: e' = J e + d,\qquad e(t + h) = \Phi\,e(t) + \int \Phi(t + h, s)\,d(s)\,ds .

The claim has four times the larger one of the two, which have nothing but y and the equations in common.

The attitude is carried on with the motion, hence its errors are too: a small turn φ of the body, seen from
it, and azimuths obey

.. math:: \varphi' = \varphi \times \omega + \delta\omega ,\qquad \delta\psi_k' = \nabla\dot\psi_k \cdot e .
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.defect.equations import Equations
from service.dynamics.equations.euler_poisson import euler_poisson_rhs
from service.dynamics.equations.orientation import azimuth_rate
from service.dynamics.potentials.potential import Potential
from service.dynamics.solution.dense_output import UNIT_ROUNDOFF, DenseOutput
from workers.solvers.integration.errors import CollisionError, IntegrationError
from workers.solvers.integration.followed import UNCHECKED_TIME_SHARE, followed
from workers.solvers.integration.interface import Integrator, Run, joined

FloatArray = NDArray[np.float64]

DIFFERENCE_FACTOR = 4.0
"""On the difference. Above the level of rounding it is the error of the worse run, and 1 would do; at that
level two runs err alike and independently, and may differ by less than either errs. With both factors the
claim was never below the actual error in thousands of random problems held against 64-bit significands."""
SHARED_RELATIVE_ROUNDING = 4.0 * UNIT_ROUNDOFF
"""Error that two runs share, relative to the variables: the rounded state, time, moments and coefficients."""


COARSE_DEFECT_RATIO = 8.0
"""Times as much defect may the coarser run leave at a kink. With the same for both they err alike there, and
their difference does not show it; like this it shows seven times what the finer one leaves."""
EXPONENTIAL_ORDER = 9
"""Order of the exponential's series: see :data:`workers.solvers.compiled.general.growth.LONGEST_NORM`."""
RESIDUAL_NODES = 8
"""Nodes of Gauss, at least, at which d is taken in a part of a piece; more where its degree is higher."""
RESIDUAL_ORDER = 4
"""Order of the exponential by which d is carried to the end of its part."""
PIECES_TOGETHER = 512
"""Pieces of which J is found at once: some 50 MB."""


@dataclass(frozen=True, slots=True)
class Span:
    """The times from ``first`` ≤ 0 to ``last`` ≥ 0."""

    first: float
    last: float

    def uniform(self, count: int) -> FloatArray:
        """Return ``count`` equidistant times, both ends included."""
        return np.linspace(self.first, self.last, count)


@dataclass(frozen=True, slots=True)
class RunPair:
    """Two runs from t = 0 in both directions."""

    fine: DenseOutput
    coarse: DenseOutput
    span: Span
    """Where both runs have arrived."""
    ending: IntegrationError | None
    """Why that is less than what was asked for, or None; the earlier one of two."""
    local_tolerance: float
    """Local tolerance of the finer run."""
    growth: FloatArray
    """Part of the claim in each piece of the finer run: what errors that it makes on its way grow to."""
    residual: FloatArray
    """Largest error in each piece of the finer run by what it leaves of the equations, to first order."""

    @property
    def steps(self) -> int:
        """Steps of the finer run."""
        return len(self.fine.breaks) - 1

    def difference(self, times: FloatArray) -> FloatArray:
        """Return the largest difference of the two runs in any variable, shape (n,)."""
        difference: FloatArray = np.abs(self.fine(times) - self.coarse(times)).max(axis=1)
        return difference

    def error_estimate(self, body: RigidBody, potential: Potential, times: FloatArray) -> FloatArray:
        """Return the estimated error of the finer run at ``times``, shape (n,).

        To the difference, or what the residual shows, comes what errors on the way grow to, and what both
        runs share: the variables are rounded, and so are the time and the constants of the problem, which set
        the rate at which the motion goes through time.
        """
        states = self.fine(times)
        rates = euler_poisson_rhs(body, potential, states[:, :3], states[:, 3:])
        speed = np.maximum(np.abs(rates.omega).max(axis=1), np.abs(rates.gamma).max(axis=1))
        rounding = SHARED_RELATIVE_ROUNDING * (np.abs(states).max(axis=1) + np.abs(times) * speed)
        piece = np.searchsorted(self.fine.breaks[1:-1], times, side="right")
        seen = np.maximum(self.difference(times), self.residual[piece])
        estimate: FloatArray = DIFFERENCE_FACTOR * seen + rounding + self.growth[piece]
        return estimate


def run_pair(
    integrator: Integrator,
    equations: Equations,
    state: FloatArray,
    neighbour: FloatArray,
    span: Span,
    *,
    local_tolerance: float,
    max_steps: int,
) -> RunPair:
    """Integrate over ``span`` from ``state`` finely, and from ``neighbour`` less so.

    Every step of both is held against the ``equations``, which are those of ``integrator``.
    ``local_tolerance`` is that of the coarser run.
    """
    finer = local_tolerance / integrator.tightening
    ends = [end for end in (span.first, span.last) if end != 0.0]
    fine = [
        followed(integrator, equations, state, end, local_tolerance=finer, max_steps=max_steps)
        for end in ends
    ]
    other = integrator.neighbour()
    coarse = [
        followed(
            other,
            equations,
            neighbour,
            # Into a singularity each goes on its own: how much they differ there tells an error.
            end if isinstance(run.ending, CollisionError) else run.reached,
            local_tolerance=local_tolerance,
            max_steps=max_steps,
            looseness=COARSE_DEFECT_RATIO,
        )
        for run, end in zip(fine, ends, strict=True)
        if run.reached != 0.0
    ]
    moving = [run for run in fine if run.reached != 0.0]
    apart = np.abs(neighbour - state)
    left_out = finer * integrator.leaves_out
    on_the_way = [errors_on_the_way(equations, run, apart, left_out) for run in moving]
    pairs = list(zip(moving, coarse, [found.deviations for found in on_the_way], strict=True))
    endings = [_ending(*pair) for pair in pairs] + [run.ending for run in fine if run.reached == 0.0]
    reached = [min(one.reached, two.reached, key=abs) for one, two, _ in pairs]
    return RunPair(
        fine=_both_sides(fine, state),
        coarse=_both_sides(coarse, neighbour),
        span=Span(min([0.0, *reached]), max([0.0, *reached])),
        ending=min(
            (ending for ending in endings if ending is not None),
            key=lambda ending: abs(ending.time),
            default=None,
        ),
        local_tolerance=finer,
        growth=_claimed(pairs),
        residual=_in_order(moving, [found.by_residual for found in on_the_way]),
    )


def _claimed(pairs: list[tuple[Run, Run, FloatArray]]) -> FloatArray:
    """Return the part of the claim in each piece of both sides."""
    from workers.solvers.compiled.general.run_pair import beyond_first_order  # noqa: PLC0415

    parts = []
    for run, _, deviations in pairs:
        size = float(np.abs(run.coefficients).max())
        claims = [beyond_first_order(DIFFERENCE_FACTOR * each, size) for each in deviations.tolist()]
        parts.append(np.array(claims))
    return _in_order([run for run, *_ in pairs], parts)


def _in_order(runs: list[Run], parts: list[FloatArray]) -> FloatArray:
    """Return what is known of the pieces of runs in the order of time; one 0 if nothing moves."""
    ordered = [part[::-1] if run.reached < 0.0 else part for run, part in zip(runs, parts, strict=True)]
    return np.concatenate(ordered) if ordered else np.zeros(1)


def _ending(fine: Run, coarse: Run, deviations: FloatArray) -> IntegrationError | None:
    """Return why two runs arrive no further; the time of a collision gets its error."""
    found = [run.ending for run in (fine, coarse) if run.ending is not None]
    collisions = [ending for ending in found if isinstance(ending, CollisionError)]
    if len(collisions) < 2:
        return min(found, key=lambda ending: abs(ending.time), default=None)
    from workers.solvers.compiled.general.run_pair import time_left  # noqa: PLC0415

    ending = collisions[0]
    left = time_left(fine.breaks)
    time = fine.reached + left
    gap = abs(coarse.reached + time_left(coarse.breaks) - time)
    last = int(np.searchsorted(np.abs(fine.breaks[1:]), (1.0 - UNCHECKED_TIME_SHARE) * abs(fine.reached)))
    last = min(last, len(deviations) - 1)
    step = fine.breaks[last + 1] - fine.breaks[last]
    speed = float(np.abs(2.0 * fine.coefficients[last, 1::2].sum(axis=0) / step).max())
    error = (
        DIFFERENCE_FACTOR * gap
        + abs(left)
        + DIFFERENCE_FACTOR * deviations[last] / speed
        + 8.0 * UNIT_ROUNDOFF * abs(time)
    )
    return CollisionError(time=time, error=error, start=ending.start, end=ending.end)


@dataclass(frozen=True, slots=True)
class ErrorsOnTheWay:
    """Errors of a run in each of its pieces, the largest of any variable, shape (pieces,)."""

    deviations: FloatArray
    """Standard deviation of independent errors of the modelled size."""
    by_residual: FloatArray
    """The error that the residual makes, to first order."""
    turned_deviations: FloatArray
    """Standard deviations of φ and of the azimuths, shape (pieces, 3 + azimuths); or of none."""
    turned_by_residual: FloatArray
    """The errors of the same that the residual makes."""


STATE, TURN = 6, 3
"""Number of variables, and of components of φ."""


def errors_on_the_way(
    equations: Equations, run: Run, start: FloatArray, left_out: float, axes: Sequence[int] | None = None
) -> ErrorsOnTheWay:
    """Return what errors a run has made, by a model of what it loses and by its residual.

    A step leaves out ``left_out``, relative to the largest variable. With ``axes`` of the body those of its
    attitude and of their azimuths are told too. Kernels find the same of series whose
    terms they know: see :func:`workers.solvers.compiled.general.growth.grown`.
    """
    from workers.solvers.compiled.general import growth  # noqa: PLC0415

    size = float(np.abs(run.coefficients).max())
    count = STATE if axes is None else STATE + TURN + len(axes)
    found, by_residual = [np.zeros((0, count))], [np.zeros((0, count))]
    spread, error = np.zeros((count, count)), np.zeros(count)
    spread[:STATE, :STATE] = np.diag((start / size) ** 2)
    steps = np.diff(run.breaks)
    for begin in range(0, len(steps), PIECES_TOGETHER):
        series, times = (
            run.coefficients[begin : begin + PIECES_TOGETHER],
            steps[begin : begin + PIECES_TOGETHER],
        )
        apart = _distances(series)
        middle = _derivatives(equations, series, apart, np.zeros((len(series), 1)))[1][:, 0]
        norms = np.abs(middle).sum(axis=1).max(axis=1)
        needed = np.abs(times) * norms / growth.LONGEST_NORM
        parts = np.where(needed < np.inf, np.clip(np.ceil(needed), 1.0, growth.MOST_PARTS), 1.0).astype(int)
        piece = np.repeat(np.arange(len(series)), parts)
        first = np.cumsum(parts) - parts
        half = (1.0 / parts)[piece]
        centre = (2.0 * (np.arange(len(piece)) - first[piece]) + 1.0) * half - 1.0
        nodes = centre[:, None] + half[:, None] * growth.OUTER_NODE * np.array([-1.0, 0.0, 1.0])
        states, jacobians = _derivatives(equations, series[piece], apart[piece], nodes)
        lost = (np.abs(jacobians[:, 1]) * np.abs(states[:, 1, None])).sum(axis=2)
        lost[:, :3] += _halves_of_torque(equations, states[:, 1, 3:]) / equations.moments
        lost *= (UNIT_ROUNDOFF * np.abs(times)[piece] * np.sqrt(half))[:, None]
        # The tolerance is of the largest variable; of others, as their last coefficients are.
        tails = np.abs(series[:, 2 * series.shape[1] // 3 :]).sum(axis=1)
        shares = tails / np.maximum(tails.max(axis=1, keepdims=True), np.finfo(np.float64).tiny)
        largest = np.abs(series).sum(axis=1).max(axis=1, keepdims=True)
        lost[first + parts - 1] += left_out * largest * shares
        lost = np.pad(lost / size, ((0, 0), (0, count - STATE)))
        if axes is not None:
            jacobians = _with_turn(states, jacobians, axes)
        left = _residuals(equations, series[piece], times[piece], centre, half, jacobians) / size
        deviations, errors = passed_on(jacobians, times[piece] * half, lost, left, spread, error)
        found.append(size * np.maximum.reduceat(deviations, first))
        by_residual.append(size * np.maximum.reduceat(errors, first))
    both = np.concatenate(found), np.concatenate(by_residual)
    return ErrorsOnTheWay(
        *(each[:, :STATE].max(axis=1) for each in both), *(each[:, STATE:] for each in both)
    )


@np.errstate(all="ignore")
def _with_turn(states: FloatArray, jacobians: FloatArray, axes: Sequence[int]) -> FloatArray:
    """Return J with the rows of φ and of the azimuths; of those what :func:`.azimuth_rate` says."""
    count = STATE + TURN + len(axes)
    found = np.zeros((*jacobians.shape[:2], count, count))
    found[:, :, :STATE, :STATE] = jacobians
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        found[:, :, STATE + i, i] = 1.0
        found[:, :, STATE + i, STATE + j] = states[:, :, k]
        found[:, :, STATE + i, STATE + k] = -states[:, :, j]
    for row, axis in enumerate(axes, start=STATE + TURN):
        found[:, :, row, :STATE] = azimuth_rate(states, axis)[1]
    return found


@np.errstate(all="ignore")
def _residuals(
    equations: Equations,
    series: FloatArray,
    times: FloatArray,
    centre: FloatArray,
    half: FloatArray,
    jacobians: FloatArray,
) -> FloatArray:
    """Return what the residual of each part adds to the error at its end, shape (parts, order of J).

    A part is that of the piece ``series``, which takes ``times``, from centre − half to centre + half of
    [−1, 1]. Φ from a node to the end is the exponential of the mean of J, to RESIDUAL_ORDER.
    """
    from workers.solvers.compiled.general import growth  # noqa: PLC0415

    degree = series.shape[1] - 1
    x, weights = np.polynomial.legendre.leggauss(max(RESIDUAL_NODES, degree + 1))
    table = np.polynomial.chebyshev.chebvander(centre[:, None] + half[:, None] * x, degree)
    slopes = np.polynomial.chebyshev.chebder(series, axis=1) * (2.0 / times)[:, None, None]
    states, rates = table @ series, table[:, :, :degree] @ slopes[:, :degree]
    left = rates - equations.at(states.reshape(-1, 6))[0].reshape(states.shape)
    left = np.pad(left, ((0, 0), (0, 0), (0, jacobians.shape[-1] - STATE)))
    lengths = 0.5 * times * half
    to_the_end = lengths[:, None] * (1.0 - x)
    # J through its three nodes, and its mean from x to the end.
    first, second, third = (jacobians[:, k, None] for k in range(3))
    slope, bend = (third - first) / (2.0 * growth.OUTER_NODE), (first - 2.0 * second + third) / 1.2
    to_1 = x[:, None, None]
    mean = second + slope * (0.5 * (1.0 + to_1)) + bend * ((1.0 + to_1 + to_1 * to_1) / 3.0)
    carried, term = left, left
    for order in range(1, RESIDUAL_ORDER + 1):
        term = (mean @ term[..., None])[..., 0] * (to_the_end / order)[:, :, None]
        carried = carried + term
    carried = np.where(np.isfinite(carried), carried, left)
    added: FloatArray = np.einsum("k,nki->ni", weights, carried) * lengths[:, None]
    return added


@np.errstate(all="ignore")
def passed_on(
    nodes: FloatArray,
    times: FloatArray,
    deviations: FloatArray,
    residuals: FloatArray,
    spread: FloatArray,
    error: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the standard deviations, and errors, of d variables at the end of each part of a run: (n, d).

    J at the three nodes of the parts, their lengths, the standard deviations of the errors that they add, and
    what their residuals add, relative to one size, have the shapes (n, 3, d, d), (n,), (n, d) and
    (n, d). ``spread`` is P at the start, shape (d, d), and ``error`` the error there, shape (d,); both are
    replaced by those at the end.
    """
    found, errors = np.empty(deviations.shape), np.empty(deviations.shape)
    added, residuals = (np.where(np.abs(part) < np.inf, part, 0.0) for part in (deviations, residuals))
    added = added**2
    for n, transition in enumerate(_transitions(nodes, times)):
        spread[...] = transition @ spread @ transition.T + np.diag(added[n])
        # Where one error is 1e8 times all others, roundings of P are more than these, of either sign.
        found[n] = np.sqrt(np.abs(np.diag(spread)))
        error[...] = transition @ error + residuals[n]
        errors[n] = np.abs(error)
    return found, errors


def _transitions(nodes: FloatArray, times: FloatArray) -> FloatArray:
    """Return Φ over each part, shape (n, d, d): Magnus' exponential of order 6; 1 where J is not known."""
    x, y, z = (nodes[:, k] for k in range(3))
    h = times[:, None, None]
    one, two, three = h * y, np.sqrt(15.0) / 3.0 * h * (z - x), 10.0 / 3.0 * h * ((z - y) - (y - x))
    first = one @ two - two @ one
    inner = 2.0 * three + first
    second = two - (one @ inner - inner @ one) / 60.0
    outer = first - 20.0 * one - three
    exponent = one + three / 12.0 + (outer @ second - second @ outer) / 240.0
    exponent[~np.isfinite(exponent).all(axis=(1, 2))] = 0.0
    one = np.eye(exponent.shape[-1])
    found = np.broadcast_to(one, exponent.shape)
    for k in range(EXPONENTIAL_ORDER, 0, -1):
        found = one + exponent @ found / k
    return found


def _distances(series: FloatArray) -> FloatArray:
    """Return half the distances of the states whose rates are compared, shape (pieces, 6)."""
    from workers.solvers.compiled.general import growth  # noqa: PLC0415

    way = np.abs(series[:, 1:]).sum(axis=1)
    reach = way + np.abs(series[:, 0])
    turn, goes, reach = reach[:, :3].max(axis=1), way[:, 3:].max(axis=1), reach[:, 3:].max(axis=1)
    by_turn = growth.DIFFERENCE_SHARE * np.where(turn > 0.0, turn, 1.0)
    nearest, farthest = growth.LEAST_DIFFERENCE * reach, growth.LARGEST_DIFFERENCE * reach
    by_way = np.minimum(np.maximum(growth.DIFFERENCE_SHARE * goes, nearest), farthest)
    return np.repeat(np.stack([by_turn, by_way], axis=1), 3, axis=1)


def _derivatives(
    equations: Equations, series: FloatArray, apart: FloatArray, nodes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return states and J at the nodes, shapes (pieces, nodes, 6) and (pieces, nodes, 6, 6)."""
    table = np.polynomial.chebyshev.chebvander(nodes, series.shape[1] - 1)
    states = table @ series
    offsets = apart[:, None, None, None] * np.eye(6)[:, None] * np.array([1.0, -1.0])[:, None]
    around = states[:, :, None, None] + offsets
    with np.errstate(all="ignore"):
        rates = equations.at(around.reshape(-1, 6))[0].reshape(around.shape)
        slopes = (rates[:, :, :, 0] - rates[:, :, :, 1]) * (0.5 / apart)[:, None, :, None]
    return states, np.ascontiguousarray(np.swapaxes(slopes, 2, 3))


@np.errstate(all="ignore")
def _halves_of_torque(equations: Equations, gamma: FloatArray) -> FloatArray:
    """Return the sums of the sizes of what γ × ∂V/∂γ is the difference of, shape (n, 3)."""
    slopes = equations.potential.gradient(gamma)
    return np.stack(
        [
            np.abs(gamma[:, i] * slopes[:, j]) + np.abs(gamma[:, j] * slopes[:, i])
            for i, j in ((1, 2), (2, 0), (0, 1))
        ],
        axis=1,
    )


def _both_sides(runs: list[Run], state: FloatArray) -> DenseOutput:
    """Join the runs; what has no extent becomes a constant over the shortest time there is."""
    moving = [run for run in runs if run.reached != 0.0]
    backward = next((run for run in moving if run.reached < 0.0), None)
    forward = next((run for run in moving if run.reached > 0.0), None)
    if not moving:
        shortest = float(np.finfo(np.float64).tiny)
        forward = Run(np.array([0.0, shortest]), state.reshape(1, 1, 6).copy(), None)
    return joined(backward, forward)
