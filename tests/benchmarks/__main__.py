"""``make bench``: what things cost, rivals side by side, each with its error."""

import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from service.dynamics.problem import PlanarMotion, TimePeriods
from service.dynamics.verdict.verdict import decide
from tests.support.planar import body, formula, planar
from tests.support.serving import serving
from workers.solvers.integration.solve import integrate_state
from workers.solvers.quadrature.solve import solve_planar

EIGHT_TERMS = (
    "-2*g1 + (8*g1*(g1^2+g3^2) + g3^4/g1)/20"
    " + (16*g1*(8*g1^4+16*g1^2*g3^2+9*g3^4) + 16*g3^6/g1 - g3^8/g1^3)/200"
    " + 1/(50*g3^2) + (g1^2-g3^2)/(500*g3^6) + (2*g1^4-2*g1^2*g3^2+g3^4)/(4000*g3^10)"
    " + (g1^2-g2^2)/5 + g2^2*(2*g1^2+g3^2)/10"
)
PROBLEM = {
    "body": {"A": 2, "C": 1},
    "potential": {"type": "gravity", "a": -1},
    "motion": {"type": "planar", "nu": 1},
    "time": {"periods": 1, "samples": 101},
}


def main() -> int:
    """Measure and print."""
    verdicts()
    methods()
    service()
    return 0


def verdicts() -> None:
    """Time the verdict on the paper's potential and on a simple one."""
    rigid_body = body(2, 1)
    formulas = {"eight terms": EIGHT_TERMS, "-g1": "-g1", "-g1 + 1e-30 g1 g2": "-g1 + 1e-30*g1*g2"}
    for name, text in formulas.items():
        potential = formula(text, rigid_body)
        seconds = median(lambda V=potential: decide(rigid_body, V), 15)
        say(f"verdict on {name:<20} median {1e3 * seconds:8.2f} ms")


def methods() -> None:
    """Compare ways to 1000 samples of one motion; the reference is a quadrature with its claim."""
    rigid_body = body(2, 1, "3/2")
    potential = formula("-g1 + 1/(20*g3^2)", rigid_body)
    for periods in (1, 10, 100):
        times = TimePeriods(Fraction(periods), 1000)
        problem = planar(rigid_body, potential, PlanarMotion(None, nu=Fraction(1)), times)
        motion = solve_planar(problem)
        state, grid = motion.dense(np.zeros(1))[0], motion.times

        def rhs(_: float, y: np.ndarray) -> tuple[float, ...]:
            # In plain floats, which is what a careful user of solve_ivp would write for one state.
            p, q, r, g1, g2, g3 = y.tolist()
            V_1, V_2, V_3 = potential.gradient_at(g1, g2, g3)
            return (
                (0.5 * q * r + g2 * V_3 - g3 * V_2) / 2.0,
                (-1.0 * p * r + g3 * V_1 - g1 * V_3) / 1.5,
                0.5 * p * q + g1 * V_2 - g2 * V_1,
                r * g2 - q * g3,
                p * g3 - r * g1,
                q * g1 - p * g2,
            )

        def by_scipy() -> np.ndarray:
            return solve_ivp(rhs, (0, grid[-1]), state, "DOP853", grid, rtol=1e-11, atol=1e-12).y.T  # noqa: B023

        def by_integration() -> np.ndarray:
            return integrate_state(rigid_body, potential, state[:3], state[3:], grid, tolerance=1e-9).samples  # noqa: B023

        ours = median(lambda: solve_planar(problem), 5)  # noqa: B023
        say(f"{periods} period(s), 1000 samples:")
        say(f"  quadrature    {1e3 * ours:9.1f} ms   error ≤ {motion.error:.1e}")
        for name, rival in (("integration", by_integration), ("solve_ivp", by_scipy)):
            error = float(np.abs(rival() - motion.samples).max())
            seconds = median(rival, 1 if periods == 100 else 3)
            say(f"  {name:<13} {1e3 * seconds:9.1f} ms   error   {error:.1e}   ratio {seconds / ours:8.1f}")


def service() -> None:
    """Time the start of the service and the round trip of small jobs."""
    with tempfile.TemporaryDirectory() as folder, serving(Path(folder)) as running:
        say(f"polhode serve to /readyz: {running.seconds_to_ready:.2f} s")
        times = []
        for k in range(40):
            # Each problem is new, or the answer would come from the database.
            problem = {**PROBLEM, "potential": {"type": "gravity", "a": f"-{1000 + k}/1000"}}
            began = time.perf_counter()
            answer = running.call("POST", "/v1/jobs", problem, Prefer="wait=10")
            times.append(time.perf_counter() - began)
            assert answer.document["state"] == "succeeded"
        say(
            f"POST /v1/jobs with Prefer: wait, idle service: median {1e3 * statistics.median(times):.1f} ms,"
            f" slowest {1e3 * max(times):.1f} ms of {len(times)}"
        )


def median(action: Callable[[], object], repeats: int) -> float:
    """Return the median time of a warm call in seconds."""
    action()
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        action()
        times.append(time.perf_counter() - began)
    return statistics.median(times)


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
