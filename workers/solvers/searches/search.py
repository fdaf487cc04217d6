"""Searches boxes of unknown numbers for what gives a wanted period, energy or precession.

A box is cut until on each part it is proved, for every window, that a condition is missed everywhere, or
that there is one solution (interval Newton). What is neither at the end, or has no bounds, is undecided.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from typing import Literal

from flint import arb, ctx

from service.dynamics.discovery.setting import Tell, untold
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.problem import PlanarMotion, Problem, Start, StartAtEquator, StartAtPoint
from service.dynamics.reduction.geometry.loop import make_loop
from service.dynamics.reduction.window import Arc, StartingPoint
from service.dynamics.reduction.window import Window as ReducedWindow
from service.dynamics.reduction.windows import NoMotionError, find_windows
from service.dynamics.solution.dense_output import exact_middle
from workers.solvers.certified.by_integral import IntegralMotion, integral_motion
from workers.solvers.certified.orbit import passes_pole
from workers.solvers.errors import PrecisionNeededError
from workers.solvers.searches.family import ProblemFamily
from workers.solvers.searches.model import (
    COARSE_BITS,
    BoundedFunction,
    FamilyWindow,
    Numbers,
    Slopes,
    energy_model,
    period_model,
    precession_model,
)
from workers.solvers.searches.structure import (
    Box,
    halves,
    is_analytic_at_poles,
    joined,
    share_of,
    windows_stay,
)

Of = Literal["period", "energy", "precession.psi1", "precession.psi3"]

SEARCH_BITS = 96
"""Precision of the search; solutions are enclosed again at twice as many."""
SOLUTION_BITS = 80
"""Bits of the values at a solution."""
MAX_HALF_BOX_SHARE = Fraction(1, 2)
"""Half a box is at most this share of the radius of the polydisc about its middle."""
MIN_BOX_SHARE = Fraction(1, 2**34)
"""A box of this share of the interval is not cut any more."""
MAX_LEAVES_PER_SIDE = 1024
"""Leaves of a box are at least this part of it."""
NEWTON_TRIES = 6


@dataclass(frozen=True, slots=True)
class Target:
    """A number of the motion and what it is to be."""

    of: Of
    equals: Callable[[], arb]
    """Returns the number at the current precision."""


@dataclass(frozen=True, slots=True)
class FoundNumbers:
    """Enclosures of the unknowns, among which there is a solution of this window, and how that is known."""

    values: tuple[arb, ...]
    window: int
    proof: Literal["proved", "possible"] = "proved"
    """A solution that a search of boxes has proved is the only one among them."""

    def is_same(self, other: "FoundNumbers") -> bool:
        """Whether both enclose one solution: that of boxes side by side."""
        pairs = zip(self.values, other.values, strict=True)
        return self.window == other.window and all(x.overlaps(y) for x, y in pairs)


@dataclass(frozen=True, slots=True)
class SearchResult:
    """All solutions that were proved, and the boxes in which nothing is."""

    solutions: tuple[FoundNumbers, ...]
    undecided: tuple[Box, ...]


@dataclass(frozen=True, slots=True)
class FamilySearch:
    """A family, what is wanted of it, and when to stop."""

    family: ProblemFamily
    problem_at: Callable[[Numbers], Problem]
    conditions: Sequence[Target]
    is_late: Callable[[], bool]
    windows: int | None = None
    """The number of windows on the whole box, where that is proved."""
    is_even: bool = True
    """V is even in g2 for all numbers, or for none that are met: mirror images are one window."""
    tell: Tell = untold
    """Is told the share of the box that is settled, or given up."""

    @property
    def needs_period(self) -> bool:
        """A motion without a period is no solution."""
        return any(each.of != "energy" for each in self.conditions)

    def arcs_at(self, at: Numbers) -> list[tuple[ReducedWindow, Arc]]:
        """Return the windows at a point, each with one of its arcs, or with all, if mirror images may differ.

        Raises
        ------
        DynamicsError
            They are not settled.
        """
        problem = self.problem_at(at)
        try:
            found = find_windows(problem.body, problem.potential, problem.motion_as(PlanarMotion))
        except NoMotionError:
            found = ()
        return [(each, arc) for each in found for arc in (each.arcs[:1] if self.is_even else each.arcs)]

    def motions_stay(self, box: Box) -> bool:
        """Whether the motions at both ends of an interval are proved to go over into each other.

        Each window stays then, with its number, and V is analytic wherever its motion goes: what depends on
        the motion and on derivatives of V is continuous.
        """
        with ctx.workprec(SEARCH_BITS):
            if not windows_stay(self.family, box):
                return False
            try:
                ends = [self.arcs_at(end) for end in zip(*box, strict=True)]
            except DynamicsError:
                return False
            # Windows neither meet nor pass a pole, so that their order along the curve stays: their numbers,
            # which go by the largest |g1|, need not.
            first, last = ([window.index for window, _ in sorted(end, key=_place)] for end in ends)
            goes_round = any(arc.is_whole_loop or passes_pole(arc) for _, arc in ends[0])
            return first == last and (not goes_round or is_analytic_at_poles(self.family, box))


def _place(found: tuple[ReducedWindow, Arc]) -> float:
    return float(found[1].lower.mid())


def search(question: FamilySearch, whole: Box) -> SearchResult:
    """Return the solutions in a box."""
    with ctx.workprec(SEARCH_BITS):
        return _Search(question, whole).found()


class _Search:
    def __init__(self, question: FamilySearch, whole: Box) -> None:
        self._question, self._whole = question, whole
        self._solutions: list[FoundNumbers] = []
        self._undecided: list[Box] = []

    def found(self) -> SearchResult:
        waiting, done = [self._whole], 0.0
        while waiting:
            box = waiting.pop()
            if self._question.is_late():
                self._undecided.append(box)
            elif not self._is_settled(box):
                if not self._is_narrow(box):
                    waiting += halves(box, self._whole)
                    continue
                self._undecided.append(box)
            done += share_of(box, self._whole)
            self._question.tell(done)
        ordered = sorted(self._solutions, key=lambda each: float(each.values[0].mid()))
        return SearchResult(tuple(ordered), tuple(joined(self._undecided)))

    def _is_narrow(self, box: Box) -> bool:
        return all(
            high - low <= MIN_BOX_SHARE * (top - bottom)
            for (low, high), (bottom, top) in zip(box, self._whole, strict=True)
        )

    def _is_settled(self, box: Box) -> bool:
        """Settle all windows of a box; False if it has to be cut first."""
        middle = [(low + high) / 2 for low, high in box]
        radii = [(high - low) / 2 / MAX_HALF_BOX_SHARE for low, high in box]
        try:
            seen = self._windows(middle)
            models = [(window, self._models(window, arc, middle, radii)) for window, arc in seen]
            for window, wanted in models:
                self._settle(window, wanted, box)
        except (DynamicsError, PrecisionNeededError):
            return False
        return True

    def _windows(self, at: Numbers) -> list[tuple[FamilyWindow, Arc]]:
        """Return the windows at a point that can be solutions, each with an arc."""
        question, seen = self._question, self._question.arcs_at(at)
        if question.windows not in (None, len(seen)):
            raise PrecisionNeededError("the windows of a part")
        return [_seen(*pair) for pair in seen if pair[0].kind == "periodic" or not question.needs_period]

    def _models(
        self, window: FamilyWindow, arc: Arc, centre: Numbers, radii: Numbers
    ) -> list[BoundedFunction]:
        family, found = self._question.family, list[BoundedFunction]()
        for condition in self._question.conditions:
            if condition.of == "energy":
                found.append(energy_model(family, window.side, centre, radii))
            elif condition.of == "period":
                motion_at = partial(self._motion_at, arc)
                found.append(period_model(family, window, motion_at, centre, radii))
            else:
                found.append(self._precession(condition.of, window, centre, radii))
        return found

    def _motion_at(self, arc: Arc, at: Numbers, ends: tuple[arb, arb], bits: int) -> IntegralMotion:
        problem = self._question.problem_at(at)
        loop = make_loop(problem.body, problem.potential, problem.motion_as(PlanarMotion))
        here = replace(arc, loop=loop, lower=ends[0].mid(), upper=ends[1].mid())
        # The period is the same from every start.
        return integral_motion(StartingPoint(here, here.lower, 0), bits)

    def _precession(self, of: Of, window: FamilyWindow, centre: Numbers, radii: Numbers) -> BoundedFunction:
        family = self._question.family
        model = precession_model(family, window, centre, radii)
        if window.ends is not None:
            return model
        motion = self._question.problem_at(centre).motion_as(PlanarMotion)
        sense = motion.sign_of_g1 * motion.g3_sign * (1 if motion.start is None else _s_sign(motion.start))
        # ψ1 gains the advance and ψ3 loses the rest of a turn; the mirror to A < C exchanges the axes.
        if (of == "precession.psi1") != family.mirrored:
            return model.moved(lambda: arb(0), sense if not family.mirrored else -sense)
        whole = sense if family.mirrored else -sense
        return model.moved(lambda: whole * 2 * arb.pi(), -whole)

    def _settle(self, window: FamilyWindow, models: Sequence[BoundedFunction], box: Box) -> None:
        """Settle a window on a box.

        Raises
        ------
        PrecisionNeededError
            The bounds are too rough for it: those of a smaller box are closer.
        """
        smallest = [(high - low) / MAX_LEAVES_PER_SIDE for low, high in box]
        waiting = [box]
        while waiting:
            leaf = waiting.pop()
            if self._question.is_late():
                self._undecided.append(leaf)
                continue
            middle = [(low + high) / 2 for low, high in leaf]
            half = [ball((high - low) / 2) for low, high in leaf]
            slopes = list[Slopes]()
            for model, condition in zip(models, self._question.conditions, strict=True):
                # The first ones take least time.
                slopes.append(model.slopes(middle, COARSE_BITS))
                if not slopes[-1].range_on(half).overlaps(condition.equals()):
                    break
            else:
                if not self._has_solved(window, models, slopes, middle, half):
                    if all(high - low < s for (low, high), s in zip(leaf, smallest, strict=True)):
                        raise PrecisionNeededError("a bound of derivatives")
                    waiting += halves(leaf, self._whole)

    def _has_solved(
        self,
        window: FamilyWindow,
        models: Sequence[BoundedFunction],
        slopes: Sequence[Slopes],
        middle: Numbers,
        half: Sequence[arb],
    ) -> bool:
        """Find the only solution of a leaf, or that it has none, by Newton's step on twice the leaf."""
        wide = [2 * r for r in half]
        if not all(r < R for r, R in zip(wide, slopes[0].radii, strict=True)):
            return False
        matrix = [each.gradient_on(wide) for each in slopes]
        step = _solved(matrix, self._missed(slopes))
        if step is None:
            return False
        if any(abs(x) > r for x, r in zip(step, half, strict=True)):
            return True
        if not all(abs(x) < r for x, r in zip(step, wide, strict=True)):
            return False
        values = [x + ball(m) for x, m in zip(step, middle, strict=True)]
        self._add(window, self._polished(models, values))
        return True

    def _polished(self, models: Sequence[BoundedFunction], values: Sequence[arb]) -> tuple[arb, ...]:
        """Narrow a solution, of which there is one among these ``values``."""
        with ctx.workprec(2 * SEARCH_BITS):
            for _ in range(NEWTON_TRIES):
                at = [exact_middle(x) for x in values]
                slopes = [model.slopes(at, SOLUTION_BITS) for model in models]
                matrix = [each.gradient_on([x.rad() for x in values]) for each in slopes]
                step = _solved(matrix, self._missed(slopes))
                if step is None:
                    break
                closer = [x.intersection(ball(m) + dx) for x, m, dx in zip(values, at, step, strict=True)]
                if not any(new.rad() < old.rad() / 2 for new, old in zip(closer, values, strict=True)):
                    break
                values = closer
            return tuple(values)

    def _missed(self, slopes: Sequence[Slopes]) -> list[arb]:
        return [c.equals() - each.value for c, each in zip(self._question.conditions, slopes, strict=True)]

    def _add(self, window: FamilyWindow, values: tuple[arb, ...]) -> None:
        """Add a solution, unless it is outside of the intervals, or was found from the box beside."""
        inside = all(
            x.overlaps(ball(low).union(ball(high)))
            for x, (low, high) in zip(values, self._whole, strict=True)
        )
        found = FoundNumbers(values, window.index)
        if inside and not any(map(found.is_same, self._solutions)):
            self._solutions.append(found)


def _seen(window: ReducedWindow, arc: Arc) -> tuple[FamilyWindow, Arc]:
    if arc.is_whole_loop:
        return FamilyWindow(0, None, window.index), arc
    side = 0 if passes_pole(arc) else 1 if ((arc.lower + arc.upper) / 2).sin() > 0 else -1
    return FamilyWindow(side, (arc.lower.mid(), arc.upper.mid()), window.index), arc


def _s_sign(start: Start) -> int:
    return start.s_sign if isinstance(start, StartAtEquator | StartAtPoint) else 1


def _solved(matrix: Sequence[Sequence[arb]], right: Sequence[arb]) -> list[arb] | None:
    """Return an enclosure of all solutions of one or two linear equations; None if they may be many."""
    if len(right) == 1:
        found = [right[0] / matrix[0][0]]
    else:
        (a, b), (c, d) = matrix
        determinant = a * d - b * c
        found = [(d * right[0] - b * right[1]) / determinant, (a * right[1] - c * right[0]) / determinant]
    return found if all(x.is_finite() for x in found) else None
