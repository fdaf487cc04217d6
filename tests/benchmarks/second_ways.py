"""``python -m tests.benchmarks.second_ways``: do the solvers earn their lines that others could stand in for?

Elliptic functions in doubles against the quadrature in balls, which has the same motions; and the certified
tier by one series on a strip against pieces of time, which need no strip. Then whole requests, with and
without each second way: the gain that a user sees. Decision 14 shows the result.
"""

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from unittest.mock import patch

import numpy as np
from flint import arb, ctx

from service.dynamics.formula.algebras.monomials import NotAMonomialSumError
from service.dynamics.formula.tape import Tape
from service.dynamics.motion import Motion
from service.dynamics.problem import PlanarMotion, Problem, TimeSpan
from service.dynamics.reduction.window import starting_point
from service.dynamics.reduction.windows import choose_window, find_windows
from service.jobs.records import Solved
from service.storage.codecs.packing import SOLVED, decode_points
from service.verdicts.examination import examine_problems
from tests.benchmarks.cached_examinations import forgetful
from tests.benchmarks.measuring import in_turns, in_words, median, say
from tests.support.examinations import examination_of
from tests.support.planar import body, formula, planar
from workers.computation.compiled_code import keep_compiled_code
from workers.computation.compute import solve_document
from workers.solvers import choose
from workers.solvers.assembly.families import Declined, PeriodicPlace, Place
from workers.solvers.certified.by_integral import IntegralMotion, integral_motion, periodic_window
from workers.solvers.choose import FAMILIES, FamilyName
from workers.solvers.closed_form import ClosedFormFamily
from workers.solvers.ways import Way
from workers.sweeping import chunk

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


@dataclass(frozen=True)
class Request:
    """What a user waits for."""

    name: str
    run: Callable[[], str]
    """Returns what is claimed, in words."""


@dataclass(frozen=True)
class SecondWay:
    """A way that another one could stand in for, how it is left out, and requests that take it."""

    name: str
    without: Callable[[], AbstractContextManager[object]]
    requests: tuple[Request, ...]


def job(name: str, tier: str, A: str, text: str, way: Way = "compiled", **more: object) -> Request:
    """Return a job from its document to its solution."""
    document = problem_of(A, text, {"accuracy": {"tier": tier}, **more})
    return Request(f"{tier} job, {name}", partial(solved_document, json.dumps(document), way))


def problem_of(A: str, text: str, more: Mapping[str, object]) -> dict[str, object]:
    return {
        "body": {"A": A, "B": "5/2" if A == "3" else "3/2", "C": 1},
        "potential": {"type": "expression", "expression": text},
        "motion": {"type": "planar", "lambda": 1},
        "time": {"stop": 10, "samples": 101},
        **more,
    }


def curve(k: int) -> dict[str, object]:
    """Return the motion number k of a list."""
    return {"motion": {"type": "planar", "lambda": f"{900 + k}/1000"}}


def solved_document(document: str, way: Way) -> str:
    outcome = solve_document(document, way=way)
    if not isinstance(outcome, Solved):
        return str(outcome.error)
    return f"{outcome.summary['error']:.0e}"


def examined(name: str, documents: Sequence[object]) -> Request:
    """Return the examination of a list of problems that nothing is known of."""
    text = json.dumps(examination_of(documents))

    def run() -> str:
        found = json.loads(examine_problems(text))
        return f"{len(found['found'])} found"

    return Request(f"list of {len(documents)}, {name}", run)


def swept(
    name: str, count: int, base: Mapping[str, object], axis: Mapping[str, object], keep: Sequence[str] = ()
) -> Request:
    """Return a sweep of so many points, as one chunk."""
    sweep = {"base": base, "axes": [axis], "keep": ["period", "error", *keep]}
    document = json.dumps({"sweep": sweep, "first": 0, "count": count, "way": "compiled"})

    def run() -> str:
        # The plan of an earlier run may have the other way.
        chunk._solver_of.cache_clear()
        points = decode_points(chunk.compute_chunk(document).data)
        return f"{points.outcomes.count(SOLVED)} solved, {np.nanmax(points.numbers['error']):.0e}"

    return Request(f"{count} points, {name}", run)


def nothing(*_: object) -> None:
    """Stand in for a shortcut that finds nothing."""


def not_a_power_sum(*_: object) -> None:
    raise NotAMonomialSumError


@contextmanager
def without_power_sums() -> Iterator[None]:
    with (
        patch("service.dynamics.verdict.proofs.power_sums.judge_power_sum", not_a_power_sum),
        patch("workers.sweeping.planar.potentials.judge_power_sum", not_a_power_sum),
    ):
        yield


@contextmanager
def without_elliptic_enclosures() -> Iterator[None]:
    rows = tuple(
        replace(row, asked=tuple(each for each in row.asked if each != "elliptic"))
        for row in choose.ENCLOSURES
    )
    # Rows are looked up once.
    choose.enclosure_row_for.cache_clear()
    with patch.object(choose, "ENCLOSURES", rows):
        yield
    choose.enclosure_row_for.cache_clear()


@contextmanager
def without_roots() -> Iterator[None]:
    with (
        patch("workers.solvers.compiled.solve.rational_radicand", nothing),
        patch("workers.sweeping.planar.by_roots.rational_family", nothing),
    ):
        yield


def unknown(of_each: object, samples: np.ndarray, *shape: int) -> np.ndarray:
    """Stand in for numbers of samples that are not known."""
    return np.full((len(samples), *shape), np.nan)


@contextmanager
def without_twice_the_digits() -> Iterator[None]:
    compiled, kept = "workers.solvers.compiled.integrals", "workers.sweeping.planar.outputs"

    def further(integrals: object, samples: np.ndarray) -> np.ndarray:
        return unknown(integrals, samples, 2)

    with (
        patch(f"{compiled}.energies_at", unknown),
        patch(f"{compiled}.further_drifts_of_many", further),
        patch(f"{kept}.drifts_of_many", lambda *given: unknown(None, given[5], 3)),
        patch(f"{kept}.further_drifts_of_many", further),
    ):
        yield


THREE_TERMS = "-g1 + 1/(20*g3^2)"
CUBIC = "(3*g1^2 + g3^2)*(g2^2 - 1/2 + g2^3/5)"
EXPONENTIAL = "(17/10*g1^2 + g3^2)*(exp(g2/2) - 3/2)"
QUARTIC = "-g1 + (2*g1^2 + g3^2)*g2^2/50"
GENERAL_SUM = {"type": "general", "F": "w/5 + w^2/10", "G": "-3*(6/10 - g2^2) + 3/10*g2"}
HIGH = {"accuracy": {"tier": "high"}}
INVARIANTS = {"outputs": ["gamma", "omega", "invariants"]}
DRIFT = "invariants.energy.drift"
LAMBDAS_500 = {"pointer": "/motion/lambda", "linspace": ["9/10", "11/10", 500]}
LAMBDAS = {"pointer": "/motion/lambda", "linspace": ["9/10", "11/10", 100]}
OUTPUTS = ["gamma", "omega"]
SECOND_WAYS = (
    SecondWay(
        "elliptic functions in doubles",
        lambda: patch.object(ClosedFormFamily, "takes", lambda *_: False),
        (
            job("three terms", "certified", "2", THREE_TERMS),
            job("next to a separatrix", "high", "2", "-g1 + 0.809017*(g1^2 - g2^2)"),
            job("three terms, plain way", "standard", "2", THREE_TERMS, "plain"),
        ),
    ),
    SecondWay(
        "elliptic functions in balls",
        without_elliptic_enclosures,
        (
            job("three terms", "certified", "2", THREE_TERMS),
            job("next to a separatrix", "certified", "2", "-g1 + 0.809017*(g1^2 - g2^2)"),
        ),
    ),
    SecondWay(
        "programs for balls",
        lambda: patch.object(Tape, "program", nothing),
        (
            job("α = 2", "certified", "2", THREE_TERMS),
            job("α = 3", "certified", "3", CUBIC),
            job("an exponential, by quadrature", "standard", "17/10", EXPONENTIAL, method="quadrature"),
            job("α = 3, by quadrature", "standard", "3", CUBIC, method="quadrature"),
            examined("α = 3", [problem_of("3", CUBIC, curve(k)) for k in range(50)]),
            examined("different formulas", [problem_of("3", f"{k + 1}*{CUBIC}", {}) for k in range(50)]),
        ),
    ),
    SecondWay(
        "exact roots",
        without_roots,
        (
            job("round the loop", "high", "2", "-g1"),
            job("round the loop, quartic", "high", "2", QUARTIC),
            swept("high, round the loop", 100, problem_of("2", "-g1", HIGH), LAMBDAS),
            swept("high, round the loop, quartic", 100, problem_of("2", QUARTIC, HIGH), LAMBDAS),
        ),
    ),
    SecondWay(
        "drifts with twice the digits",
        without_twice_the_digits,
        (
            job("with invariants", "standard", "2", THREE_TERMS, outputs=[*OUTPUTS, "invariants"]),
            job("with invariants", "standard", "3", CUBIC, outputs=[*OUTPUTS, "invariants"]),
            swept(
                "with the energy's drift",
                500,
                problem_of("2", THREE_TERMS, INVARIANTS),
                LAMBDAS_500,
                keep=[DRIFT],
            ),
        ),
    ),
    SecondWay(
        "sums of powers in sweeps of moments",
        without_power_sums,
        (
            swept(
                "over A",
                100,
                problem_of("2", "(A*g1^2 + C*g3^2)*(g2^2 - 1/2)", {}),
                {"pointer": "/body/A", "linspace": [2, "23/10", 100]},
            ),
        ),
    ),
    SecondWay(
        "doubles for attitude and stability",
        lambda: patch("workers.computation.outputs.takes_doubles", lambda *_: False),
        (
            job("with orientation", "standard", "2", "-g1", outputs=[*OUTPUTS, "orientation"]),
            job("with stability", "standard", "2", THREE_TERMS, outputs=[*OUTPUTS, "stability"]),
        ),
    ),
    SecondWay(
        "windows of a list together",
        lambda: patch(
            "service.dynamics.reduction.windows.halves_in_doubles", lambda loops, _: [None] * len(loops)
        ),
        (
            examined("α = 3", [problem_of("3", CUBIC, curve(k)) for k in range(50)]),
            examined("α = 2", [problem_of("2", THREE_TERMS, curve(k)) for k in range(50)]),
        ),
    ),
    SecondWay(
        "V1 of powers of w",
        lambda: patch("service.dynamics.potentials.angular_part.balls.powers_of", nothing),
        (
            job(
                "F = w/5 + w²/10",
                "standard",
                "17/10",
                "",
                potential=GENERAL_SUM,
            ),
        ),
    ),
)


def whole_requests() -> None:
    """Print what each request takes with and without its second way."""
    heads = "| second way | request | with: time, claim | without: time, claim | gain |"
    say(f"\n{heads}\n| --- | --- | --- | --- | --- |")
    for second in SECOND_WAYS:
        for request in second.requests:
            say(request_row(second, request))


def request_row(second: SecondWay, request: Request) -> str:
    """Measure one request both ways, in turns."""

    def without() -> str:
        with second.without():
            return request.run()

    ours, theirs = in_turns((forgetful(request.run), forgetful(without)), REPEATS // 3)
    cells = f"{in_words(ours)}, {request.run()} | {in_words(theirs)}, {without()}"
    return f"| {second.name} | {request.name} | {cells} | {theirs / ours:.2f} |"


def main() -> int:
    """Measure and print all tables, in Markdown."""
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
    whole_requests()
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
        place = PeriodicPlace(window, starting_point(window, problem.motion))
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
