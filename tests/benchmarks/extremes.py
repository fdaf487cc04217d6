"""``python -m tests.benchmarks.extremes``: what everyone does at the extremes, written to docs/extremes.md.

Errors are the largest of the six variables at the samples, against the motion
in balls of 4000 bits. One run of each, so times are rough. ``--only S2`` computes the rows whose names begin
so; the others stay as they are on the page.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from service.dynamics.errors import DynamicsError
from service.jobs.records import Refused
from service.storage.codecs.packing import decode_arrays
from tests.extremes.elliptic import BITS, Elliptic, ball, elliptic
from tests.extremes.problems import SEPARATRIX, STATE
from tests.support.planar import body, formula
from workers.computation.compiled_code import keep_compiled_code
from workers.computation.compute import solve_checked
from workers.solvers.integration.solve import integrate_state

FloatArray = NDArray[np.float64]

TIERS = ("draft", "standard", "high", "certified")
"""Tiers of the method auto that are columns of the table."""
SAMPLES = 9
PATIENCE = 2.0
"""Seconds of the processor after which a rival is stopped."""
REPORT = Path(__file__).parents[2] / "docs" / "extremes.md"
ONE, ZERO = Fraction(1), Fraction(0)


@dataclass(frozen=True)
class Extreme:
    """A motion in three terms, sampled over some periods; B is 3/2 for the integrators."""

    name: str
    ends: str
    a1: Fraction
    b1: Fraction
    c1: Fraction
    nu: Fraction = ONE
    periods: Fraction = ONE

    def reference(self) -> Elliptic:
        return elliptic(self.ends, nu=self.nu, a1=self.a1, b1=self.b1, c1=self.c1)

    @property
    def parameters(self) -> dict[str, Fraction]:
        return {"a1": self.a1, "b1": self.b1, "c1": self.c1}

    def document(self, accuracy: dict[str, str], method: str) -> str:
        problem = {
            "body": {"A": 2, "C": 1},
            "potential": {
                "type": "expression",
                "expression": EXPRESSION,
                "parameters": {name: str(value) for name, value in self.parameters.items()},
            },
            "motion": {"type": "planar", "nu": str(self.nu), **({"window": 1} if self.name == "S4" else {})},
            "time": {"periods": str(self.periods), "samples": SAMPLES},
            "accuracy": accuracy,
            "method": method,
        }
        return json.dumps(problem)


EXPRESSION = "a1*g1 + b1/g3^2 + c1*(g1^2-g2^2)"


class PatienceError(Exception):
    """A rival took too long."""


def gap(bits: int) -> Fraction:
    """c1* (1 − 2^-bits), to 64 bits of the gap."""
    return Fraction(round(SEPARATRIX * (1 - Fraction(1, 2**bits)) * 2 ** (bits + 64)), 2 ** (bits + 64))


def extremes() -> list[Extreme]:
    ten, twentieth = Fraction(10), Fraction(1, 20)
    plain = Extreme("nothing extreme", "WE", -ONE, twentieth, ZERO)
    return [
        plain,
        *(
            Extreme(f"S1, gap 2^-{bits} to the separatrix", "PE", -ONE, ZERO, gap(bits))
            for bits in (13, 27, 40, 52, 60, 100, 210, 400)
        ),
        *(Extreme(f"S2, a1 = 1e-{e}", "WE", ten**-e, ZERO, -ONE) for e in (4, 12, 30, 150)),
        Extreme("S3, gap 1e-6", "WW", -ONE, twentieth, Fraction(5, 4) * (1 - ten**-6)),
        Extreme("S3, gap 1e-30", "WW", -ONE, twentieth, Fraction(5, 4) * (1 - ten**-30)),
        Extreme("S4", "WE", ONE, -(1 - ten**-8) / 16, -ONE),
        *(Extreme(f"S6, nu = 1e{e}", "PE", -ONE, ZERO, ZERO, ten**e) for e in (-24, -12, 6, 12, 24)),
        *(Extreme(f"S10, b1 = 1e-{e}", "WE", -ONE, ten**-e, ZERO) for e in (6, 12, 150)),
        *(
            Extreme(f"S11, V times 1e{e}", "WE", -(ten**e), ten**e / 20, ZERO)
            for e in (-150, -31, 6, 31, 150)
        ),
        *(
            Extreme(f"1e{e} periods", "WE", -ONE, twentieth, ZERO, periods=ten**e)
            for e in (2, 4, 6, 9, 12, 15)
        ),
    ]


def ours(extreme: Extreme, accuracy: dict[str, str], method: str) -> str:
    """Return error, claim and time of the service, or its refusal."""
    began = time.process_time()
    outcome = solve_checked(extreme.document(accuracy, method))
    seconds = time.process_time() - began
    if isinstance(outcome, Refused):
        return f"`{outcome.error['code']}`, {spent(seconds)}"
    columns = decode_arrays(outcome.samples)
    with ctx.workprec(BITS):
        period = extreme.reference().period
        times = [ball(extreme.periods * k / (SAMPLES - 1)) * period for k in range(SAMPLES)]
    error = largest_error(extreme, times, np.stack([columns[name] for name in STATE], axis=1))
    return f"{error:.0e} of {outcome.summary['error']:.0e} claimed, {spent(seconds)}"


def rival(extreme: Extreme, integrate: Callable[[Extreme, FloatArray, FloatArray], FloatArray]) -> str:
    """Return error and time of an integrator from the rounded start, or what became of it."""
    with ctx.workprec(BITS):
        motion = extreme.reference()
        start = np.array([float(value) for value in motion.state(arb(0))])
        last = float(motion.period) * float(extreme.periods)
    times = np.linspace(0.0, last, SAMPLES)
    began = time.process_time()
    try:
        states = integrate(extreme, start, times)
    except DynamicsError as refusal:
        return f"`{refusal.code}`, {spent(time.process_time() - began)}"
    except PatienceError:
        return f"not done in {PATIENCE:.0f} s"
    except (ArithmeticError, ValueError) as fault:
        return f"{type(fault).__name__}, {spent(time.process_time() - began)}"
    seconds = time.process_time() - began
    if len(states) < SAMPLES or not np.all(np.isfinite(states)):
        return f"stops on the way, {spent(seconds)}"
    return f"{largest_error(extreme, [arb(t) for t in times.tolist()], states):.0e}, {spent(seconds)}"


def by_scipy(extreme: Extreme, start: FloatArray, times: FloatArray) -> FloatArray:
    potential = formula(EXPRESSION, body(2, 1, "3/2"), extreme.parameters)
    patience = time.process_time() + PATIENCE

    def rhs(_: float, y: FloatArray) -> tuple[float, ...]:
        if time.process_time() > patience:
            raise PatienceError
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

    with np.errstate(all="ignore"):
        solved = solve_ivp(rhs, (0.0, times[-1]), start, "DOP853", times, rtol=1e-10, atol=1e-12)
    found: FloatArray = solved.y.T
    return found


def by_heyoka(extreme: Extreme, start: FloatArray, times: FloatArray) -> FloatArray:
    if extreme.periods > 10**4:
        raise PatienceError  # it takes 10 µs a step and cannot be interrupted
    rigid_body = body(2, 1, "3/2")
    potential = formula(EXPRESSION, rigid_body, extreme.parameters)
    return integrate_state(rigid_body, potential, start[:3], start[3:], times, tolerance=1e-2).samples


def largest_error(extreme: Extreme, times: Sequence[arb], states: FloatArray) -> float:
    worst = 0.0
    with ctx.workprec(BITS):
        motion = extreme.reference()
        for t, state in zip(times, states, strict=True):
            exact = motion.state(t)
            worst = max(worst, *(float(abs(e - arb(float(s)))) for e, s in zip(exact, state, strict=True)))
    return worst


def spent(seconds: float) -> str:
    return f"{1e3 * seconds:.0f} ms"


def main() -> int:
    columns: dict[str, Callable[[Extreme], str]] = {
        **{tier: lambda x, tier=tier: ours(x, {"tier": tier}, "auto") for tier in TIERS},  # type: ignore[misc]
        "quadrature": lambda x: ours(x, {"tier": "standard"}, "quadrature"),
        "tolerance 1e-2": lambda x: ours(x, {"tolerance": "1e-2"}, "quadrature"),
        "solve_ivp": lambda x: rival(x, by_scipy),
        "heyoka": lambda x: rival(x, by_heyoka),
    }
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.extremes", description=__doc__)
    parser.add_argument("--only", default="", help="the beginning of the names of rows")
    only = parser.parse_args().only
    keep_compiled_code()
    written = {line.split(" | ")[0]: line for line in REPORT.read_text(encoding="utf-8").splitlines()}
    lines = [HEAD.strip(), "", "| | " + " | ".join(columns) + " |", "| --- " * (len(columns) + 1) + "|"]
    for extreme in extremes():
        if not extreme.name.startswith(only):
            lines.append(written[f"| {extreme.name}"])
            continue
        cells = [column(extreme) for column in columns.values()]
        lines.append(f"| {extreme.name} | " + " | ".join(cells) + " |")
        sys.stdout.write(lines[-1] + "\n")
        sys.stdout.flush()
    REPORT.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return 0


HEAD = f"""
# At the extremes

Written by `python -m tests.benchmarks.extremes`. V = a1 g1 + b1/g3² + c1 (g1² − g2²), A = 2, C = 1, from the
default start, {SAMPLES} samples over one period unless said otherwise. Errors are the largest in any of the
six variables, against the motion in balls of {BITS} bits; times are of a single run. A code is a refusal.

The tiers go the way of `auto`, which knows the closed form of these potentials; the errors of `certified` are
those of its doubles, its enclosures are far smaller. Where doubles do not keep a tier, it has these
samples too; where a size is above 1, as at λ = 1e9, errors are relative to it, in units of the motion.
`quadrature` does without closed forms and enclosures, once for 1e-10 and once for 1e-2. `solve_ivp` is
SciPy's DOP853 at rtol 1e-10;
`heyoka` is the service's own integration, asked for 1e-2. Both start from the rounded state with B = 3/2,
and have {PATIENCE:.0f} s: next to a separatrix, and where the motion is unstable against q ≠ 0, no
integrator in doubles can stay on it for long.
"""

if __name__ == "__main__":
    sys.exit(main())
