"""Reasons that make a job slow, less accurate, or refused, reported with its plan before it runs.

Seconds that are expected of a tier come from a table of usual motions. What a motion has beyond those is seen
on its curve: nothing here is a proof, and nothing is left out of a proof because of it.
"""

import numpy as np
from numpy.typing import NDArray

from service.dynamics.formula.algebras.real import RealAlgebra
from service.dynamics.formula.tape import Tape
from service.dynamics.formula.vanishing import vanishing_parts
from service.dynamics.potentials.potential import Notice, Potential
from service.dynamics.problem import PlanarMotion, Problem
from service.dynamics.reduction.geometry.tight_form import tight_form
from service.dynamics.reduction.window import Arc, Window, height

FloatArray = NDArray[np.float64]

FINE, COARSE = 1e-10, 1e-6
"""Parts of the largest term down to which terms of a series of p² are counted: doubles have few more."""
USUAL = 128
"""Terms that a motion without narrow features does not need."""
MOST, MOST_OF_INTEGRAL = 4096, 256
"""Terms that are counted at most; each takes a value of V."""
PLACES = 257
"""Between the ends of a motion, where parts of a formula are asked for their signs."""
NEXT_TO_POLE = 1e-9
INSIDE = 1e-6
"""Distance in g2 from an end of the motion at which a place is inside of it."""


def remarks_on(problem: Problem, window: Window) -> tuple[Notice, ...]:
    """Return what is remarkable about the quadrature of a planar motion; nothing of it is a refusal."""
    if problem.method == "integration" or not isinstance(problem.motion, PlanarMotion):
        return ()
    arc, *_ = window.arcs
    told = [*_of_potential(arc.loop.potential), *_of_ends(window), *_of_near_rests(arc), *_of_slopes(arc)]
    is_rough = bool(arc.poles) and not arc.loop.is_smooth_at_poles()
    if is_rough:
        told.append(
            Notice(
                "pole_passage",
                f"the motion passes a pole, where V or the motion is no power series (A/C or C/A is "
                f"{arc.loop.alpha}): its quadrature takes some hundred times as long as where it is one",
                "/motion",
            )
        )
    elif window.kind == "periodic":
        told += _of_width(arc)
    return tuple(told)


def _of_potential(potential: Potential) -> list[Notice]:
    if potential.has_formula:
        return []
    text = "V is an integral, of which each value takes as long as a hundred of a formula"
    return [Notice("integral", text, "/potential")]


def _of_ends(window: Window) -> list[Notice]:
    if window.kind == "periodic" or window.kind == "equilibrium":
        return []
    texts = {
        "collision": "p² grows without bound where the motion ends, after a finite time: later times are "
        "refused (motion_ended)",
        "pole": "the motion ends at a pole: later times may be refused (motion_ended)",
        "separatrix": "the motion approaches a rest for ever and has no period",
    }
    return [Notice(window.kind, texts[window.kind], "/motion")] if window.kind in texts else []


def _of_near_rests(arc: Arc) -> list[Notice]:
    """Return where p² nearly vanishes inside the motion."""
    return [
        Notice(
            "near_rest",
            f"at g2 = {height(arc.loop, near.v):.6g} p² nearly vanishes, within {float(near.reach):.2g} "
            "along the curve: the motion lingers there, and what doubles lose there it multiplies",
            "/motion",
        )
        for near in arc.slow
        if near.square > 0 and near.v > arc.lower and near.v < arc.upper
    ]


def _of_slopes(arc: Arc) -> list[Notice]:
    """Return where a part of the formula vanishes inside the motion that may make a slope of p² infinite."""
    potential, loop = arc.loop.potential, arc.loop
    if not potential.has_formula:
        return []
    turns = [height(loop, v) for v in (arc.lower, arc.upper, *arc.poles)]
    whole = (-1.0, 1.0) if arc.is_whole_loop else (min(turns), max(turns))
    places = np.linspace(whole[0] + INSIDE, whole[1] - INSIDE, PLACES)
    found = {_zero_on(part.part, places) for part in vanishing_parts(tight_form(potential.tape))}
    return [
        Notice(
            "infinite_slope",
            f"a root, a power or a logarithm is taken of what vanishes at g2 = {y:.6g}, which the motion "
            "passes: where a slope of p² is infinite the quadrature may tell no error, and be refused "
            '(accuracy_not_met); {"method": "integration"} needs no bound of it',
            "/potential",
        )
        for y in sorted(y for y in found if y is not None)
    ]


def _zero_on(part: Tape, places: FloatArray) -> float | None:
    """Return where a part that depends on g2 alone changes its sign between places, None if it does not."""
    nothing = np.zeros_like(places)
    with np.errstate(all="ignore"):
        values = np.broadcast_to(part.evaluate(RealAlgebra(), (nothing, places, nothing)), places.shape)
    (changes,) = np.nonzero(values[1:] * values[:-1] <= 0.0)
    return float(places[changes[0] : changes[0] + 2].mean()) if len(changes) else None


def _of_width(arc: Arc) -> list[Notice]:
    fine, coarse = terms_along(arc, FINE), terms_along(arc, COARSE)
    if fine <= USUAL:
        return []
    text = (
        f"p² has narrow features, or corners: its series along the motion has {fine} terms, or more, down to "
        f"{FINE:g} of the largest, and {coarse} down to {COARSE:g}; usual ones have {USUAL // 4}"
    )
    return [Notice("narrow_feature", text, "/potential")]


def terms_along(arc: Arc, part: float) -> int:
    """Return the number of terms of Chebyshev's series of p² along a motion, as far as terms are counted.

    Down to the last that is not below a ``part`` of the largest.
    """
    most = MOST if arc.loop.potential.has_formula else MOST_OF_INTEGRAL
    count, found = USUAL, USUAL
    while found > count // 2 and count < most:
        count *= 2
        sizes = _term_sizes(arc, count)
        (large,) = np.nonzero(sizes > part * sizes.max())
        found = int(large[-1]) + 1 if len(large) else 0
    return found


def _term_sizes(arc: Arc, count: int) -> FloatArray:
    """Return the sizes of terms of Chebyshev's series of p² along a motion, ``count`` + 1 of them."""
    low, high = float(arc.lower), float(arc.upper)
    v = 0.5 * (low + high) + 0.5 * (high - low) * np.cos(np.pi * np.arange(count + 1) / count)
    # A pole is a limit of places.
    v = np.where(np.abs(np.sin(v)) < NEXT_TO_POLE, v + NEXT_TO_POLE, v)
    P = arc.loop.radicand_real(np.sin(v), np.cos(v))
    terms = np.fft.rfft(np.concatenate([P, P[-2:0:-1]])).real / count
    return np.abs(terms)
