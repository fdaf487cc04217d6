"""One law for every arithmetic: V and its derivatives are those of balls, within its bounds."""

import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from flint import arb, ctx

from tests.support.effort import each_once
from tests.support.planar import body, formula
from workers.solvers import compiled
from workers.solvers.compiled.discs.arithmetic import run_discs
from workers.solvers.compiled.discs.rows import new_discs, run_rows
from workers.solvers.compiled.doubled.arithmetic import ROUNDING_RATIO, run_doubled
from workers.solvers.compiled.evaluation.curve import run_degrees
from workers.solvers.compiled.evaluation.interpreter import (
    derivative,
    derivative_with_bound,
    new_registers,
    run_bounded,
    run_double,
)
from workers.solvers.compiled.evaluation.program import make_program, rests_of
from workers.solvers.compiled.integrals import run_known
from workers.solvers.compiled.solve_set import new_formula
from workers.solvers.compiled.workspace import LANES

BODY = body(3, 1)
OWN_LOOPS = {"general/steps.py": "every order of a series needs the lower ones"}
"""Other kernels that read instructions, and why they do."""
FORMULAS = [
    "-g1",
    "(3*g1^2+g3^2)*(g2^2-1/2+g2^3/5)",
    "abs(g1)^(4/3)/7 - 2*abs(g3)^(-4)",
    "exp(-g1*g3) + log(abs(g3)) - sin(g1)*cos(g2) + tan(g3/2)",
    "sqrt(1+g1^2)*abs(g3) - g1/(2+g2)",
    "(2+g1)^(g3+g2) + pi*g1^40",
    "16*g1*(8*g1^4+16*g1^2*g3^2+9*g3^4) + 16*g3^6/g1 - g3^8/g1^3",
    "(2+g2)^(-1/2) - (3+g1)^(-7/3)/9 + abs(g3)^100/abs(g1)^(1/2)",
]
POINTS = 50
KERNELS = [run_double, run_bounded, run_doubled, run_known, run_discs, run_rows, run_degrees]


def run_in_lanes(code, constants, lows, registers, count):
    """Run rows of discs beside the power 0 of a scale."""
    for begin in range(0, count, LANES):
        here, discs = slice(begin, min(begin + LANES, count)), new_discs(registers.shape[1])
        number = here.stop - begin
        discs.centres[:3, :number], discs.radii[:3, :number] = registers[:, :3, here]
        run_rows(code, constants, lows, discs, number)
        for part, found in zip(registers, discs, strict=False):
            part[:, here] = found[: registers.shape[1], :number]


RUNS = {
    "double": run_double,
    "bounded": run_bounded,
    "doubled": run_doubled,
    "known": run_known,
    "discs": run_discs,
    "rows": run_in_lanes,
}
PARTS = {"double": 1, "bounded": 2, "doubled": 2, "known": 3, "discs": 2, "rows": 2}


def points(count=POINTS):
    found = np.random.default_rng(1).normal(size=(3, count))
    return found / np.linalg.norm(found, axis=0)


def registers_of(arithmetic, potential, g):
    """Return V and its gradient at points that are doubles, shape (parts of a number, 4, points)."""
    program, constants = make_program(potential.tape)
    registers = new_registers(program.gradient.code, PARTS[arithmetic], g.shape[1])
    registers[0, :3], registers[1:, :3] = g, 0.0
    rests = rests_of(potential.tape, constants)
    RUNS[arithmetic](program.gradient.code, constants, rests, registers, g.shape[1])
    return registers[:, program.gradient.results]


def distances(potential, g, *parts):
    """Return how far the sums of some parts are from V and its gradient, shape (4, points)."""
    far = np.empty(parts[0].shape)
    with ctx.workprec(300):
        for m in range(g.shape[1]):
            V, slopes, _ = potential.jet_ball(*(arb(x) for x in g[:, m].tolist()))
            for a, exact in enumerate((V, *slopes)):
                total = sum((arb(float(part[a, m])) for part in parts), arb(0))
                far[a, m] = float(abs(total - exact).upper())
    return far


@pytest.mark.one_in(2)
@pytest.mark.parametrize("text", FORMULAS)
def test_every_arithmetic_keeps_its_bounds(text):
    potential, g = formula(text, BODY), points()
    value, ulps = registers_of("bounded", potential, g)
    # First order in the roundings of every operation, none left out.
    assert (distances(potential, g, value) <= ulps * 2.0**-53).all()
    assert np.array_equal(registers_of("double", potential, g)[0], value)
    high, low = registers_of("doubled", potential, g)
    # What is said of the roundings of a radicand; the inputs are exact in both.
    assert (distances(potential, g, high, low) <= ulps * 2.0**-53 * ROUNDING_RATIO).all()
    high, low, error = registers_of("known", potential, g)
    # Bounds are rounded to nearest: whoever uses one doubles it.
    assert (distances(potential, g, high, low) <= 2.0 * error).all()
    # A function is known to 2^-94 of itself, of its argument and of 1.
    assert (error <= (1.0 + ulps) * 2.0**-92).all()
    for arithmetic in ("discs", "rows"):
        centres, radii = registers_of(arithmetic, potential, g)
        assert (distances(potential, g, centres) <= radii).all()


@each_once(text=list(FORMULAS), arithmetic=list(RUNS))
def test_no_digit_depends_on_the_points_that_are_gone_through_with_it(arithmetic, text):
    potential, g = formula(text, BODY), points(11)
    together = registers_of(arithmetic, potential, g)
    for m in range(11):
        alone = registers_of(arithmetic, potential, np.ascontiguousarray(g[:, m : m + 1]))
        assert np.array_equal(alone[..., 0], together[..., m])


@pytest.mark.parametrize("kernel", KERNELS, ids=lambda each: each.py_func.__name__)
def test_compiled_code_of_an_arithmetic_belongs_to_its_module(kernel):
    """It is found by the sources of that module; the loop itself is written in another."""
    run = kernel.py_func
    assert getattr(import_module(run.__module__), run.__qualname__) is kernel


@pytest.mark.parametrize("arithmetic", ["bounded", "known", "discs", "rows"])
@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("abs(g1)*g2", (0.0, 0.6, 0.8)),
        ("1/g3", (0.6, 0.8, 0.0)),
        ("sqrt(g3)", (0.6, 0.8, 0.0)),
        ("log(g1)", (0.0, 0.6, 0.8)),
    ],
)
def test_there_is_no_bound_where_there_is_no_derivative(arithmetic, text, place):
    *_, errors = registers_of(arithmetic, formula(text, BODY), np.array(place)[:, None])
    assert not np.isfinite(errors).all()


@pytest.mark.one_in(2)
@pytest.mark.parametrize("text", FORMULAS)
def test_the_derivative_on_the_loop_is_that_of_balls_within_its_bound(text):
    potential, g = formula(text, BODY), points()
    program, constants = make_program(potential.tape)
    worked = new_formula(*program[:3], constants)
    D, ulps = (part.copy() for part in derivative_with_bound(worked, *g, POINTS))
    with ctx.workprec(200):
        exact = [potential.D_ball(*(arb(x) for x in g[:, k].tolist())) for k in range(POINTS)]
        assert all(
            abs(arb(d) - e) <= u * 2.0**-53 for d, e, u in zip(D.tolist(), exact, ulps.tolist(), strict=True)
        )
    assert np.array_equal(derivative(worked, *g, POINTS), D)


def test_every_other_loop_over_instructions_is_listed_here():
    folder = Path(compiled.__path__[0])
    reading = {
        source.relative_to(folder).as_posix()
        for source in folder.rglob("*.py")
        if re.search(r"\bcode\[\w+, 0\]", source.read_text(encoding="utf-8"))
    }
    assert reading == {"evaluation/interpreter.py", *OWN_LOOPS}
