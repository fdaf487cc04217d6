"""``python -m tests.benchmarks.second_ways``: do the solvers earn their lines that others could stand in for?

Elliptic functions in doubles against the quadrature in balls, which has the same motions; and the certified
tier by one series on a strip against pieces of time, which need no strip. Decision 14 shows the result.
"""

import sys
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

from flint import arb, ctx

from service.dynamics.motion import Motion
from service.dynamics.problem import PlanarMotion, Problem, TimeSpan
from service.dynamics.reduction.start import starting_point
from service.dynamics.reduction.windows import choose_window, find_windows
from tests.benchmarks.measuring import median, say
from tests.support.planar import body, formula, planar
from workers.computation.compiled_code import keep_compiled_code
from workers.solvers.assembly.families import Declined, Place, periodic_place
from workers.solvers.certified.by_integral import IntegralMotion, integral_motion, periodic_window
from workers.solvers.choose import FAMILIES, FamilyName

REPEATS = 15
ELLIPTIC = (
    ("pole to equator", "-g1"),
    ("rest to equator", "-g1 + 1/(20*g3^2)"),
    ("rest to rest", "-g1 + 1/(50*g3^2) + 6/5*(g1^2 - g2^2)"),
)
"""Motions of bodies with A = 2C, at nu = 1."""
GENERAL = (
    ("A = 3C", 3, "(3*g1^2 + g3^2)*(g2^2 - 1/2 + g2^3/5)", "4/5"),
    ("A = 4C, through the poles", 4, "-g1*(4*g1^2+3*g3^2) + (4*g1^2+g3^2)/10", "9/10"),
    ("A = 1.7C", Fraction(17, 10), "(17/10*g1^2 + g3^2)*(g2^2 - 1/2)", "6/5"),
)


class ByPieces(IntegralMotion):
    """The same motion by pieces of time."""

    strip = None


def main() -> int:
    """Measure and print both tables, in Markdown."""
    keep_compiled_code()
    say("| three terms | closed form: time, claim | quadrature: time, claim | ratio |")
    say("| --- | --- | --- | --- |")
    for name, text in ELLIPTIC:
        say(elliptic_row(name, text))
    heads = "| certified, 64 bits | what | one strip: time, radius | pieces: time, radius | ratio |"
    say(f"\n{heads}\n| --- | --- | --- | --- | --- |")
    for name, A, text, lambda_ in GENERAL:
        for row in certified_rows(name, Fraction(A), text, Fraction(lambda_)):
            say(row)
    return 0


def elliptic_row(name: str, text: str) -> str:
    """Solve one motion of three terms by both families, from the place to 101 samples and the series."""
    rigid_body = body(2, 1)
    problem = planar(
        rigid_body, formula(text, rigid_body), PlanarMotion(None, nu=Fraction(1)), tolerance=1e-10
    )
    problem = replace(problem, method="auto", time=TimeSpan(Fraction(0), Fraction(10), 101))
    assert isinstance(problem.motion, PlanarMotion)
    with ctx.workprec(256):
        window = choose_window(find_windows(rigid_body, problem.potential, problem.motion), problem.motion)
        place = periodic_place(Place(window, starting_point(window, problem.motion)))
        ours, theirs = (solved(problem, place, family) for family in ("closed form", "quadrature"))
    return f"| {name} | {ours[1]} | {theirs[1]} | {theirs[0] / ours[0]:.1f} |"


def solved(problem: Problem, place: Place, family: FamilyName) -> tuple[float, str]:
    """Return the seconds of one family, and them with its claim in words; nan if it declines."""
    found = FAMILIES[family].solve(problem, place)
    if isinstance(found, Declined):
        return float("nan"), "declined"
    assert isinstance(found, Motion)
    seconds = median(lambda: FAMILIES[family].solve(problem, place), REPEATS)
    return seconds, f"{1e3 * seconds:.2f} ms, {found.error:.0e}"


def certified_rows(name: str, A: Fraction, text: str, lambda_: Fraction) -> list[str]:
    """Enclose a period, and 200 samples of ten periods, by both."""
    rigid_body = body(A, 1)
    motion = PlanarMotion(lambda_)
    rows = []
    with ctx.workprec(192):
        start = periodic_window(rigid_body, formula(text, rigid_body), motion)[1]
        for what, count in (("period", 0), ("200 samples", 200)):
            times = [arb(k) / 5 for k in range(count)]

            def by_strip(times: Sequence[arb] = times) -> arb:
                return widest(integral_motion(start, 64), times)

            def by_pieces(times: Sequence[arb] = times) -> arb:
                made = integral_motion(start, 64)
                return widest(ByPieces(made.phase, made.start, made.energy, made.bits), times)

            one, other = median(by_strip, REPEATS), median(by_pieces, REPEATS)
            cells = (
                f"{1e3 * seconds:.1f} ms, {float(radius):.0e}"
                for seconds, radius in ((one, by_strip()), (other, by_pieces()))
            )
            rows.append(f"| {name} | {what} | {' | '.join(cells)} | {other / one:.1f} |")
    return rows


def widest(motion: IntegralMotion, times: Sequence[arb]) -> arb:
    """Return the largest radius of what is asked for."""
    if not times:
        return motion.period.rad()
    return max((value.rad() for state in motion.states(times) for value in state), key=float)


if __name__ == "__main__":
    sys.exit(main())
