"""``python -m tests.benchmarks.fast``: the compiled solver against integrators, ratios with both errors."""

import multiprocessing
import subprocess
import sys
import time
from collections.abc import Callable
from fractions import Fraction

import heyoka as hy
import numpy as np
from flint import arb, ctx
from scipy.integrate import solve_ivp

from service.dynamics.body import RigidBody
from service.dynamics.dense_output import reduce_time
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion, StartAtRest, TimeList
from tests.benchmarks.__main__ import median, say
from tests.support.planar import body, formula, planar
from workers.solvers.quadrature.solve import solve_planar
from workers.solvers.spectral.motion import SpectralMotion
from workers.solvers.spectral.program import parametric_program
from workers.solvers.spectral.solve import solve_many, solve_spectral

NU_1 = PlanarMotion(None, nu=Fraction(1))
DOUBLE = body(2, 1, "3/2")
ELLIPTIC = "-g1 + 1/(20*g3^2)"
STEPS = (1e-7, 1e-8, 1e-9, 1e-10, 3e-11, 1e-11, 3e-12, 1e-12, 3e-13, 1e-13, 3e-14)


def main() -> int:
    """Measure and print."""
    against_scipy()
    against_heyoka()
    any_time()
    near_the_separatrix()
    sweep()
    known_structure()
    return 0


def solved(rigid_body: RigidBody, potential: Potential, motion: PlanarMotion, tier: str) -> SpectralMotion:
    """Return the motion, which is there."""
    found = solve_spectral(rigid_body, potential, motion, tier=tier)
    assert found is not None
    return found


def right_side(
    rigid_body: RigidBody, potential: Potential
) -> Callable[[float, np.ndarray], tuple[float, ...]]:
    """Return the Euler-Poisson equations in plain floats, as a careful user of solve_ivp writes them."""
    A, B, C = float(rigid_body.A), float(rigid_body.B or 1), float(rigid_body.C)

    def rhs(_: float, y: np.ndarray) -> tuple[float, ...]:
        p, q, r, g1, g2, g3 = y.tolist()
        V_1, V_2, V_3 = potential.gradient_at(g1, g2, g3)
        return (
            ((B - C) * q * r + g2 * V_3 - g3 * V_2) / A,
            ((C - A) * p * r + g3 * V_1 - g1 * V_3) / B,
            ((A - B) * p * q + g1 * V_2 - g2 * V_1) / C,
            r * g2 - q * g3,
            p * g3 - r * g1,
            q * g1 - p * g2,
        )

    return rhs


def against_scipy() -> None:
    """Print target 1: 1000 samples at 1e-10 against DOP853 at the loosest rtol that reaches it."""
    cases = (
        ("A=2C", DOUBLE, ELLIPTIC, NU_1),
        ("α=1.4", body("7/5", 1, "6/5"), LIBRATION, PlanarMotion(Fraction(4, 5), start=StartAtRest(-1))),
        ("α=1.7", body("17/10", 1, "13/10"), LIBRATION, PlanarMotion(Fraction(4, 5), start=StartAtRest(-1))),
        ("α=3", body(3, 1, "5/2"), LIBRATION, PlanarMotion(Fraction(4, 5), start=StartAtRest(-1))),
    )
    for name, rigid_body, text, motion in cases:
        potential = formula(text, rigid_body)
        rhs = right_side(rigid_body, potential)
        for periods in (10, 100) if name == "A=2C" else (10,):
            tier = "high" if periods == 100 else "standard"
            found = solved(rigid_body, potential, motion, tier)
            grid = np.linspace(0.0, periods * found.period.hi, 1000)
            reference = truth(rigid_body, potential, motion, grid)
            ours = found.sample(grid)
            seconds = median(lambda: solved(rigid_body, potential, motion, tier).sample(grid), 15)  # noqa: B023
            for rtol in STEPS:
                began = time.perf_counter()
                theirs = solve_ivp(
                    rhs, (0, grid[-1]), reference[0], "DOP853", grid, rtol=rtol, atol=rtol / 10
                ).y.T
                theirs_seconds = time.perf_counter() - began
                error = float(np.abs(theirs - reference).max())
                if error <= 1e-10:
                    break
            say(
                f"1. {name:<6} {periods:>4} periods  {tier:<9} {1e3 * seconds:7.3f} ms  "
                f"error {np.abs(ours - reference).max():.1e} (claimed {found.error_at(grid):.1e})   "
                f"DOP853 {rtol:.0e} {1e3 * theirs_seconds:8.1f} ms  error {error:.1e}   "
                f"ratio {theirs_seconds / seconds:8.0f}"
            )


LIBRATION = "(A*g1^2+C*g3^2)*(g2^2-1/2+g2^3/5)"


def truth(rigid_body: RigidBody, potential: Potential, motion: PlanarMotion, times: np.ndarray) -> np.ndarray:
    """Return samples by the quadrature in balls."""
    problem = planar(rigid_body, potential, motion, TimeList((Fraction(0),)), tolerance=1e-6)
    return np.asarray(solve_planar(problem).dense(times))


def against_heyoka() -> None:
    """Print target 2: the state after 1e5 periods against heyoka at 1e-16."""
    potential, periods = formula(ELLIPTIC, DOUBLE), 100_000
    found = solved(DOUBLE, potential, NU_1, "high")
    grid = np.linspace((periods - 1) * found.period.hi, periods * found.period.hi, 1000)
    reference = truth(DOUBLE, potential, NU_1, grid)
    seconds = median(lambda: solved(DOUBLE, potential, NU_1, "high").sample(grid), 15)
    p, q, r, g1, g2, g3 = hy.make_vars("p", "q", "r", "g1", "g2", "g3")
    V_1, V_3 = -1.0, -0.1 / g3**3
    system = [
        (p, (0.5 * q * r + g2 * V_3) / 2.0),
        (q, (-1.0 * p * r + g3 * V_1 - g1 * V_3) / 1.5),
        (r, 0.5 * p * q - g2 * V_1),
        (g1, r * g2 - q * g3),
        (g2, p * g3 - r * g1),
        (g3, q * g1 - p * g2),
    ]
    integrator = hy.taylor_adaptive(system, found.sample(np.zeros(1))[0].tolist(), tol=1e-16)
    began = time.perf_counter()
    integrator.propagate_until(grid[-1])
    theirs = time.perf_counter() - began
    error = float(np.abs(integrator.state - reference[-1]).max())
    say(
        f"2. {periods} periods, samples of the last  {1e3 * seconds:7.3f} ms  "
        f"error {np.abs(found.sample(grid) - reference).max():.1e} (claimed {found.error_at(grid):.1e})   "
        f"heyoka 1e-16, one state {theirs:6.2f} s  error {error:.1e}   ratio {theirs / seconds:8.0f}"
    )


def any_time() -> None:
    """Print target 3: 1e8 periods cost what 10 do."""
    potential = formula(ELLIPTIC, DOUBLE)
    found = solved(DOUBLE, potential, NU_1, "high")
    times, errors = [], []
    for periods in (10, 100_000_000):
        grid = np.linspace((periods - 10) * found.period.hi, periods * found.period.hi, 1000)
        times.append(median(lambda: solved(DOUBLE, potential, NU_1, "high").sample(grid), 31))  # noqa: B023
        with ctx.workprec(200):
            # The period of the closed form, in balls: what the reduction of times must agree with.
            exact = [float(arb(t) - (arb(t) / GOLDEN_G4).floor() * GOLDEN_G4) for t in grid]
        near = found.sample(np.array(exact))
        errors.append(float(np.abs(near - found.sample(grid)).max()))
        reduced = np.abs(reduce_time(grid, found.period) - exact)
        errors[-1] = max(errors[-1], float(np.minimum(reduced, found.period.hi - reduced).max()))
    say(
        f"3. 1e8 periods against 10: {1e3 * times[1]:.3f} ms and {1e3 * times[0]:.3f} ms, ratio "
        f"{times[1] / times[0]:.2f};  times reduced in 200 bits: differs by {errors[1]:.1e}, {errors[0]:.1e}"
    )


with ctx.workprec(200):
    GOLDEN_G4 = 2 * arb("3.170038968616406868351677946564008046773")


def near_the_separatrix() -> None:
    """Print target 4: the cost of a gap of 1e-12."""
    with ctx.workprec(400):
        critical = Fraction(int(((1 + arb(5).sqrt()) / 4 * 10**80).floor().unique_fmpz()), 10**80)
    first = 0.0
    for gap in ("1/2", "1/1000", "1/1000000", "1/1000000000", "1/1000000000000"):
        potential = formula(f"-g1 + ({critical * (1 - Fraction(gap))})*(g1^2-g2^2)", DOUBLE)
        found = solved(DOUBLE, potential, NU_1, "high")
        grid = np.linspace(0.0, 10.0 * found.period.hi, 1000)
        reference = truth(DOUBLE, potential, NU_1, grid)
        seconds = median(lambda: solved(DOUBLE, potential, NU_1, "high").sample(grid), 15)  # noqa: B023
        first = first or seconds
        say(
            f"4. gap {float(Fraction(gap)):.0e}  {1e3 * seconds:7.3f} ms  panels {len(found.panels):>3}  "
            f"error {np.abs(found.sample(grid) - reference).max():.1e} "
            f"(claimed {found.error_at(grid):.1e})   ratio {seconds / first:.2f}"
        )


SWEEP = "a*g1 + b/g3^2"
SETS, SAMPLES = 10_000, 200


def sweep() -> None:
    """Print target 7: 10 000 sets of 200 samples against a pool of two processes with solve_ivp."""
    program, constants = parametric_program(SWEEP, ("a", "b"))
    draws = np.random.default_rng(7)
    a, b = -draws.uniform(0.5, 2.0, SETS), draws.uniform(0.01, 0.04, SETS)
    lambdas = draws.uniform(0.7, 1.4, SETS)
    rows = np.repeat(constants[None, :], SETS, axis=0)
    rows[:, 0], rows[:, 1] = a, b
    grid = np.linspace(0.0, 20.0, SAMPLES)
    motion = PlanarMotion(Fraction(1))
    solve_many(DOUBLE, program, rows[:2], motion, grid, lambdas=lambdas[:2])
    began = time.perf_counter()
    found = solve_many(DOUBLE, program, rows, motion, grid, lambdas=lambdas)
    seconds = time.perf_counter() - began
    few = 40
    jobs = [(a[k], b[k], tuple(found.samples[k, 0]), grid) for k in range(few)]
    with multiprocessing.get_context("fork").Pool(2) as pool:
        pool.map(integrate_one, jobs[:2])
        began = time.perf_counter()
        theirs = np.array(pool.map(integrate_one, jobs, chunksize=5))
        theirs_seconds = (time.perf_counter() - began) * SETS / few
    worst = 0.0
    for k in range(few):
        text = f"({Fraction(a[k])})*g1 + ({Fraction(b[k])})/g3^2"
        reference = truth(DOUBLE, formula(text, DOUBLE), PlanarMotion(Fraction(lambdas[k])), grid)
        worst = max(worst, float(np.abs(found.samples[k] - reference).max()))
    decided = int(np.isfinite(found.errors).sum())
    say(
        f"7. {SETS} x {SAMPLES}: {seconds:6.2f} s, {decided} decided, claimed at most "
        f"{found.errors[np.isfinite(found.errors)].max():.1e}, error of {few} {worst:.1e}   pool of two "
        f"{theirs_seconds:7.0f} s (from {few}), differs by "
        f"{np.abs(theirs - found.samples[:few]).max():.1e}   ratio {theirs_seconds / seconds:6.0f}"
    )


def integrate_one(job: tuple[float, float, tuple[float, ...], np.ndarray]) -> np.ndarray:
    """Integrate one set of the sweep, its equations written out by hand."""
    a, b, state, grid = job

    def rhs(_: float, y: np.ndarray) -> tuple[float, ...]:
        p, q, r, g1, g2, g3 = y.tolist()
        V_3 = -2.0 * b / (g3 * g3 * g3)
        return (
            (0.5 * q * r + g2 * V_3) / 2.0,
            (-p * r + g3 * a - g1 * V_3) / 1.5,
            0.5 * p * q - g2 * a,
            r * g2 - q * g3,
            p * g3 - r * g1,
            q * g1 - p * g2,
        )

    return np.asarray(solve_ivp(rhs, (0, grid[-1]), state, "DOP853", grid, rtol=1e-10, atol=1e-11).y.T)


FRESH = """
import time
from fractions import Fraction
from tests.support.planar import body, formula
from service.dynamics.problem import PlanarMotion
rigid_body, motion = body(2, 1), PlanarMotion(None, nu=Fraction(1))
first, second = (formula(f"-{a}*g1 + 1/(20*g3^2)", rigid_body) for a in ("3/2", "5/4"))
from workers.solvers.spectral.solve import solve_spectral
for potential in (first, second):
    began = time.perf_counter()
    assert solve_spectral(rigid_body, potential, motion, tier="standard") is not None
    print(time.perf_counter() - began)
"""


def known_structure() -> None:
    """Print target 8: the first and the second problem of a fresh process."""
    answer = subprocess.run([sys.executable, "-c", FRESH], capture_output=True, text=True, check=True)
    first, second = (float(line) for line in answer.stdout.split())
    say(
        f"8. fresh process: first problem {1e3 * first:.2f} ms, second {1e3 * second:.3f} ms, "
        f"ratio {first / second:.0f}"
    )


if __name__ == "__main__":
    sys.exit(main())
