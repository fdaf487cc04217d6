"""Problems at the extremes as documents, through the service's own door."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from math import isqrt, ulp
from typing import Any

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.problem import TimePeriods
from service.dynamics.sampling import exact_instants
from service.jobs.records import Refused
from service.schemas.problem.trusted import times_of
from service.storage.codecs.packing import decode_arrays
from tests.extremes.elliptic import BITS, Elliptic, ball
from workers.computation.compute import solve_checked

FloatArray = NDArray[np.float64]
Exact = int | str | Fraction
METHODS = ("auto", "quadrature")
"""The closed form where there is one, and the quadrature where there is a closed form too."""
STATE = ("p", "q", "r", "g1", "g2", "g3")
SEPARATRIX = (1 + Fraction(isqrt(5 << 6000), 1 << 3000)) / 4
"""c1* = (1 + √5)/4 to 900 digits: where V = −g1 + c1 (g1² − g2²) on nu = 1 has its separatrix."""


@dataclass(frozen=True)
class Answer:
    """A solution's summary and samples, or the code of a refusal."""

    code: str | None
    summary: dict[str, Any]
    columns: dict[str, FloatArray]
    time: object
    """The problem's times, as they were sent."""

    @property
    def period(self) -> float:
        return float(self.summary["period"]["value"])

    @property
    def period_error(self) -> float:
        return float(self.summary["period"]["error"])

    @property
    def error(self) -> float:
        return float(self.summary["error"])

    @property
    def states(self) -> FloatArray:
        """Shape (samples, 6)."""
        return np.stack([self.columns[name] for name in STATE], axis=1)


def solve(
    potential: str | Mapping[str, object],
    motion: Mapping[str, object],
    time: Mapping[str, object],
    *,
    body: tuple[Exact, Exact] = (2, 1),
    parameters: Mapping[str, Exact] | None = None,
    tolerance: str = "1e-10",
    method: str = "auto",
) -> Answer:
    """Solve; a refusal must have a code, and numbers must be finite."""
    if isinstance(potential, str):
        exact = {name: str(value) for name, value in (parameters or {}).items()}
        potential = {"type": "expression", "expression": potential, "parameters": exact}
    document = {
        "body": {"A": str(body[0]), "C": str(body[1]), "allow_unphysical": True},
        "potential": potential,
        "motion": {"type": "planar", **{name: _plain(value) for name, value in motion.items()}},
        "time": {name: _plain(value) for name, value in time.items()},
        "accuracy": {"tolerance": tolerance},
        "method": method,
    }
    outcome = solve_checked(json.dumps(document))
    if isinstance(outcome, Refused):
        code = outcome.error["code"]
        assert isinstance(code, str)
        assert "nan" not in str(outcome.error["detail"])
        return Answer(code, {}, {}, document["time"])
    columns = decode_arrays(outcome.samples)
    assert all(np.all(np.isfinite(values)) for values in columns.values())
    json.dumps(outcome.summary, allow_nan=False)
    assert outcome.summary["error"] <= float(Fraction(tolerance))  # type: ignore[operator]
    return Answer(None, outcome.summary, columns, document["time"])


def three_terms(
    a1: Exact,
    b1: Exact,
    c1: Exact,
    nu: Exact,
    time: Mapping[str, object],
    *,
    tolerance: str = "1e-10",
    method: str = "auto",
    **motion: object,
) -> Answer:
    """Solve for V = a1 g1 + b1/g3² + c1 (g1² − g2²), A = 2, C = 1, on the curve with this nu."""
    return solve(
        "a1*g1 + b1/g3^2 + c1*(g1^2-g2^2)",
        {"nu": str(nu), **motion},
        time,
        parameters={"a1": a1, "b1": b1, "c1": c1},
        tolerance=tolerance,
        method=method,
    )


def require_claims(answer: Answer, reference: Elliptic) -> None:
    """Assert that period and samples are within what the answer claims of the reference."""
    assert answer.code is None, answer.code
    with ctx.workprec(BITS):
        assert abs(reference.period - arb(answer.period)) <= answer.period_error
        asked = times_of(answer.time)
        unit = reference.period if isinstance(asked, TimePeriods) else arb(1)
        # At a pole itself the reference is a quotient of zeros: next to it, within 1e-600, it has its value.
        aside = reference.period * arb(2) ** -(BITS // 2)
        instants = exact_instants(asked)
        for t, column in zip(instants, answer.columns["t"].tolist(), strict=True):
            # Parts of the period know their time as well as it is known, and are rounded.
            allowed = float(abs(t)) * answer.period_error + ulp(column)
            assert abs(ball(t) * unit - arb(column)) <= allowed, f"t = {t}"
        for t, state in zip(instants, answer.states, strict=True):
            for exact, found in zip(reference.state(ball(t) * unit + aside), state, strict=True):
                assert abs(exact - arb(float(found))) <= answer.error, f"t = {t}"


def _plain(value: object) -> object:
    return str(value) if isinstance(value, Fraction) else value
