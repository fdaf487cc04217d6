"""The family of solvers for motions through poles that are not smooth there, by their way in balls.

What proves samples has time and the six variables as series in phases in which everything is smooth. In
doubles these are the function of time too, whose pieces next to a pole only shrink to what doubles tell
apart.
"""

from fractions import Fraction
from functools import cache
from itertools import pairwise
from math import inf, nan

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.motion import Motion
from service.dynamics.numerics import largest
from service.dynamics.problem import PlanarMotion, Problem, TimePeriods
from service.dynamics.reduction.windows import REDUCTION_BITS
from service.dynamics.sampling import exact_instants
from service.dynamics.solution.dense_output import EPSILON, Period, chebyshev_coefficients, chebyshev_points
from workers.solvers.assembly.dense import BALL_CHECKED_POINTS, UNSEEN_DEPARTURE_FACTOR, TimeMap, sum_series
from workers.solvers.assembly.families import NOT_MINE, Declined, PeriodicPlace, Place, Sampled, make_periodic
from workers.solvers.certified.by_integral import IntegralMotion, way_from
from workers.solvers.certified.certify import first_try
from workers.solvers.certified.orbit import passes_pole
from workers.solvers.certified.time_model import PIECE_OVERLAP, TimeModel, TimePiece
from workers.solvers.certified.way import PassagePhase, PolarWay
from workers.solvers.complex_plane.complex_loop import MAX_WHOLE_ALPHA, unit_at_poles
from workers.solvers.errors import CertifiedUnavailableError, PrecisionLostError, PrecisionNeededError
from workers.solvers.orbits.near_rest import is_slow
from workers.solvers.orbits.orbit import refine_near_poles

FloatArray = NDArray[np.float64]

SERIES_DEGREE = 32
"""Degree of series in doubles: those in balls fall like 4^-k on a piece."""
MAX_MAP_PERIODS = Fraction(16)
"""Periods, about, up to which enclosures of samples have the same time map."""
TURNED = np.array([-1.0, -1.0, -1.0, 1.0, 1.0, 1.0])
"""On the way back of a libration the angular velocity is the opposite."""


class WayFamily:
    """See :class:`workers.solvers.assembly.families.Family`."""

    def takes(self, problem: Problem, place: Place) -> bool:
        """Take what passes a pole and is no function of sin v of low degree, where V has a formula."""
        arc = place.start.arc
        if not isinstance(place, PeriodicPlace) or not passes_pole(arc) or is_slow(arc):
            return False
        loop = arc.loop
        return loop.potential.has_formula and (
            loop.alpha > MAX_WHOLE_ALPHA or unit_at_poles(loop, loop.potential.tape) > 0
        )

    def promise(self, problem: Problem) -> float:
        """Promise nothing: what it reaches, it claims."""
        return inf

    def solve(self, problem: Problem, place: Place) -> Motion | Declined:
        """Return the motion with the error that it shows; declined where nothing proves the way.

        Raises
        ------
        PrecisionLostError
            More bits are needed.
        """
        if not isinstance(place, PeriodicPlace):
            return NOT_MINE
        motion = problem.motion_as(PlanarMotion)
        times = [MAX_MAP_PERIODS] if isinstance(problem.time, TimePeriods) else exact_instants(problem.time)
        precision, bits = first_try(problem.accuracy.bits, max((abs(t) for t in times), default=Fraction(0)))
        with ctx.workprec(precision + ctx.prec - REDUCTION_BITS):
            try:
                way = way_from(problem.body, problem.potential, motion, place.start, bits)
                if not (isinstance(way.phase, PolarWay) and isinstance(model := way.model, TimeModel)):
                    return NOT_MINE
                sampled = _sampled(way, way.phase, model)
            except CertifiedUnavailableError:
                return NOT_MINE
            except PrecisionNeededError as error:
                raise PrecisionLostError(f"{error} is not known") from error
        return make_periodic(problem, place, sampled)


def _sampled(way: IntegralMotion, phase: PolarWay, model: TimeModel) -> Sampled:
    time_map, states, departure = _in_doubles(model, phase)
    sides = _sides(model, phase)
    turns = (way.origin / model.period).mid().floor()
    hi, origin = time_map.period.hi, float(way.origin - turns * model.period)

    def sample(times: FloatArray) -> FloatArray:
        local = times + origin
        panels, x = time_map.phase_at(np.where(local > hi, local - hi, local).clip(0.0, hi))
        found = np.ascontiguousarray(sum_series(states, panels, x).T)
        refine_near_poles(phase.curve.loop, found, _sines(sides[:, panels], x))
        return found

    poles = [model.time_at(stretch.begin) for stretch in phase.stretches if stretch.first == 0]
    poles += [model.period - t for t in poles] if phase.is_even else []
    passages = np.sort([float(t - origin) % hi for t in poles])
    times, widths = time_map.features()
    features, late = ((times - origin) % hi, widths), 2.0 * time_map.error
    return Sampled(
        sample, time_map.period, passages, departure, time_map.evidence(), time_error=late, features=features
    )


def _in_doubles(model: TimeModel, phase: PolarWay) -> tuple[TimeMap, FloatArray, float]:
    """Return t(u), u being the number of a piece, the six variables, and a bound of their error.

    The variables have the shape (SERIES_DEGREE + 1, 6, pieces).
    """
    pieces = model.pieces
    series = [_series(np.column_stack((_doubles(piece), piece.states))) for piece in pieces]
    departures = [_departure(phase, piece, each[:, 1:]) for piece, each in zip(pieces, series, strict=True)]
    columns: FloatArray = np.stack(series, axis=2)
    rates, states = columns[:, 0], columns[:, 1:]
    ends = [*(piece.start for piece in pieces), model.span]
    if phase.is_even:
        signs = (-1.0) ** np.arange(SERIES_DEGREE + 1)[:, None]
        rates = np.hstack((rates, (signs * rates)[:, ::-1]))
        states = np.dstack((states, (signs[:, :, None] * TURNED[:, None] * states)[:, :, ::-1]))
        ends += [model.period - t for t in ends[-2::-1]]
    integrals = np.asarray(0.5 * np.polynomial.chebyshev.chebint(rates, lbnd=-1.0, axis=0), np.float64)
    times: FloatArray = np.array([float(t) for t in ends])
    period = Period.of(model.period)
    rounding = 0.25 * EPSILON * period.hi
    lengths = [float(end - begin) for begin, end in pairwise(ends)]
    error = float(np.abs(integrals.sum(axis=0) - lengths).max())
    edges, nodes = np.arange(len(times), dtype=float), sum(len(piece.states) for piece in pieces)
    time_map = TimeMap(
        edges, rates, integrals, times, period, error, nodes, 0, kinks=np.zeros(0), rounding=rounding
    )
    return time_map, states, UNSEEN_DEPARTURE_FACTOR * largest(departures)


def _sides(model: TimeModel, phase: PolarWay) -> FloatArray:
    """Return φ where each piece begins and ends, the unit and the sign of sin v, shape (4, pieces).

    NaN where φ is not the phase.
    """
    sides = np.full((4, len(model.pieces)), nan)
    for k, piece in enumerate(model.pieces):
        stretch = phase.stretches[phase.number(piece.centre)]
        if isinstance(stretch.phase, PassagePhase):
            curve = stretch.phase.passage.curve
            ends = (float(abs(theta - stretch.shift)) for theta in (piece.begin, piece.end))
            sides[:, k] = *ends, curve.unit, curve.side
    return np.hstack((sides, sides[[1, 0, 2, 3], ::-1])) if phase.is_even else sides


def _sines(sides: FloatArray, x: FloatArray) -> FloatArray:
    """Return sin v at the places ``x`` of pieces, one for each, to the digits of φ.

    NaN unless it is small: a power has as many roundings as its exponent is large.
    """
    begin, end, unit, side = sides
    phi = np.where(x < 0.0, begin, end) + 0.5 * (end - begin) * (x - np.copysign(1.0, x))
    X = np.tan(0.5 * phi) ** unit
    return np.where(unit * X < 1.0, side * 2.0 * X / (1.0 + X * X), nan)


def _doubles(piece: TimePiece) -> FloatArray:
    """Return the coefficients of dt/du, of which a piece is as long as 2/PIECE_OVERLAP in y."""
    coefficients = np.array([float(value) for value in piece.slope.coeffs()])
    return np.pad(coefficients, (0, len(piece.states) - len(coefficients))) * (2.0 / PIECE_OVERLAP)


def _series(powers: FloatArray) -> FloatArray:
    """Return Chebyshev series on the piece of polynomials (columns) in y: it ends at ±1/PIECE_OVERLAP."""
    return chebyshev_coefficients(_at_nodes(len(powers)) @ powers)


@cache
def _at_nodes(count: int) -> FloatArray:
    return np.vander(chebyshev_points(SERIES_DEGREE) / PIECE_OVERLAP, count, increasing=True)


def _departure(phase: PolarWay, piece: TimePiece, states: FloatArray) -> float:
    """Return by how much the six variables are off where they are looked at."""
    found = []
    for x in BALL_CHECKED_POINTS:
        told: list[float] = np.atleast_1d(np.polynomial.chebyshev.chebval(x, states)).tolist()
        known = phase.state(piece.centre + piece.radius * (arb(x) / PIECE_OVERLAP))
        found += [float(abs(ball - arb(value)).abs_upper()) for ball, value in zip(known, told, strict=True)]
    return largest(found)
