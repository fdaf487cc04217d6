"""Random admissible potentials: sums of terms that solve the compatibility equation (Hypothesis)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from random import Random

from hypothesis import strategies as st

from service.dynamics.motion import Motion
from service.dynamics.problem import PlanarMotion, Problem, Times, TimeSpan
from service.dynamics.reduction.windows import find_windows
from tests.support.planar import body, formula, planar
from tests.support.solving import solve_planar

MOMENTS = [(2, 1), (3, 1), (4, 1), (5, 2), (7, 3), (1, 2), (3, 5), (1, 3)]


def coefficient(limit: int = 3) -> st.SearchStrategy[Fraction]:
    return st.fractions(-limit, limit, max_denominator=20)


@dataclass(frozen=True)
class Case:
    """A planar problem that has a periodic motion."""

    A: Fraction
    C: Fraction
    text: str
    motion: PlanarMotion
    stop: Fraction = Fraction(7)

    def problem(self, *, times: Times | None = None) -> Problem:
        rigid_body = body(self.A, self.C)
        span = times or TimeSpan(Fraction(0), self.stop, 41)
        return planar(rigid_body, formula(self.text, rigid_body), self.motion, span, tolerance=1e-9)

    def solve(self, *, times: Times | None = None) -> Motion:
        return solve_planar(self.problem(times=times))

    def changed(self, **changes: object) -> "Case":
        return replace(self, **changes)


@st.composite
def cases(draw: st.DrawFn, *, attracts: bool = False) -> Case:
    """Draw a case of :func:`_case`; where one of its powers diverges it repels, or ``attracts``."""
    return _case(
        draw(st.sampled_from(MOMENTS)),
        [draw(coefficient()) for _ in range(4)],
        draw(coefficient()),
        draw(st.fractions(0, 1, max_denominator=50)) * (-1 if attracts else 1),
        draw(st.fractions(Fraction(1, 2), 2, max_denominator=20)),
        (draw(st.sampled_from([1, -1])), draw(st.sampled_from([1, -1]))),
    )


def sampled_cases(count: int, seed: int) -> list[Case]:
    """Return cases that are the same on every machine and with every version of Hypothesis."""
    source = Random(seed)
    return [
        _case(
            source.choice(MOMENTS),
            [sampled_fraction(source, -3, 3) for _ in range(4)],
            sampled_fraction(source, -3, 3),
            sampled_fraction(source, 0, 1),
            sampled_fraction(source, Fraction(1, 2), 2),
            (source.choice([1, -1]), source.choice([1, -1])),
        )
        for _ in range(count)
    ]


def sampled_fraction(source: Random, lo: Fraction | int, hi: Fraction | int) -> Fraction:
    """Return one of 120 equal steps from lo to hi."""
    return lo + Fraction(source.randint(0, 120), 120) * (hi - lo)


def _case(
    moments: tuple[int, int],
    cubic: Sequence[Fraction],
    attraction: Fraction,
    repulsion: Fraction,
    constant: Fraction,
    signs: tuple[int, int],
) -> Case:
    """Return Q G(g2) with a cubic G, plus the homogeneous terms of lowest degree on |g1|, |g3|; any A ≠ C."""
    A, C = (Fraction(moment) for moment in moments)
    alpha = A / C
    text = "(A*g1^2 + C*g3^2)*(({}) + ({})*g2 + ({})*g2^2 + ({})*g2^3)".format(*cubic)
    # B_0 = |g1|^(2(α−1)/α) and C_0 = |g3|^(−2(α−1)); the one that diverges decides.
    first, second = (attraction, repulsion) if alpha > 1 else (repulsion, attraction)
    text += f" + ({first})*abs(g1)^({2 * (alpha - 1) / alpha})"
    text += f" + ({second})*abs(g3)^({-2 * (alpha - 1)})"
    return Case(A, C, text, PlanarMotion(constant, g1_sign=signs[0], g3_sign=signs[1]))


def with_periodic_window(case: Case) -> Case | None:
    """Return the case with its first periodic window chosen, if it has one wide enough for doubles."""
    problem = case.problem()
    for window in find_windows(problem.body, problem.potential, case.motion):
        if window.kind == "periodic" and abs(abs(window.g1[1]) - abs(window.g1[0])) > 1e-3:
            return case.changed(motion=replace(case.motion, window=window.index))
    return None
