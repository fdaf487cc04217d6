"""The fixed set of measured problems: every kind of motion, every family."""

import json
from collections.abc import Mapping
from dataclasses import dataclass

from service.dynamics.accuracy import Family, MotionKind
from service.dynamics.problem import Tier

Document = Mapping[str, object]

SAMPLES = 1000
_REFERENCE_TOLERANCE = "1e-11"
"""The integration is more accurate than this and claims its error: 1e-14 if the potential has a formula."""


@dataclass(frozen=True, slots=True)
class Case:
    """One problem, without its times and its accuracy."""

    kind: MotionKind
    family: Family
    body: Document
    potential: Document
    motion: Document
    stop: str = "999/64"
    """Such that the times of 1000 samples are doubles."""
    method: str = "auto"
    is_quick: bool = False
    """Measured by a quick calibration too."""

    def document(self, tier: Tier, samples: int) -> str:
        """Return the problem as JSON."""
        return self._problem({"tier": tier}, self.method, samples)

    def reference_document(self) -> str:
        """Return the problem for an integration with nearly all digits, as JSON."""
        return self._problem({"tolerance": _REFERENCE_TOLERANCE}, "integration", SAMPLES)

    def _problem(self, accuracy: Document, method: str, samples: int) -> str:
        return json.dumps(
            {
                "body": self.body,
                "potential": self.potential,
                "motion": self.motion,
                "time": {"start": 0, "stop": self.stop, "samples": samples},
                "accuracy": accuracy,
                "method": method,
                "outputs": ["gamma", "omega"],
            }
        )


def _rational(a: list[object], b: list[object], c: list[object]) -> Document:
    return {"type": "rational", "a": a, "b": b, "c": c}


def _formula(text: str) -> Document:
    return {"type": "expression", "expression": text}


_DOUBLE: Document = {"A": 2, "B": "3/2", "C": 1}
_NU_1: Document = {"type": "planar", "nu": 1}
_OSCILLATING = _rational([-1], ["1/50"], ["6/5"])

CASES = (
    Case("pole to equator", "three-term", _DOUBLE, _rational([-1], [], []), _NU_1, is_quick=True),
    Case("rest to equator", "three-term", _DOUBLE, _rational([-1], ["1/20"], []), _NU_1),
    Case("pole to rest", "three-term", _DOUBLE, _rational([-1], [], [2]), _NU_1),
    Case("rest to rest", "three-term", _DOUBLE, _OSCILLATING, _NU_1, is_quick=True),
    # A pole that is approached for ever.
    Case(
        "aperiodic", "three-term", _DOUBLE, _rational([], [], [-1]), _NU_1,
        stop="999/256",
    ),
    # A collision at t = 1.066.
    Case(
        "aperiodic", "three-term", _DOUBLE, _rational([-1], ["-1/20"], ["-1/2"]), _NU_1,
        stop="999/1024",
    ),
    # A separatrix that leaves an equilibrium and returns to it.
    Case(
        "aperiodic", "three-term", _DOUBLE, _rational([1], ["-1/16"], [-1]), {**_NU_1, "window": 1},
        stop="999/256",
    ),
    Case("any state", "three-term", _DOUBLE, _OSCILLATING, _NU_1, method="integration"),
    Case(
        "rest to equator", "rational", _DOUBLE,
        _rational([-2, "1/20", "1/200"], ["1/50", "1/500", "1/4000"], ["1/5", "1/10"]), _NU_1,
    ),
    Case(
        "pole to equator", "general alpha", {"A": 4, "B": "9/2", "C": 1},
        _formula("-g1*(4*g1^2 + 3*g3^2) + (4*g1^2 + g3^2)/10"), {"type": "planar", "lambda": "9/10"},
    ),
    Case(
        "rest to equator", "general alpha", {"A": 3, "B": "5/2", "C": 1},
        {"type": "homogeneous", "A": ["-1/2", 0, 1, "1/5"], "B": ["-1/3"], "C": ["1/200"]},
        {"type": "planar", "lambda": "4/5"}, is_quick=True,
    ),
    Case(
        "rest to equator", "function", _DOUBLE,
        _formula("-g1 + 1/20/g3^2 + (2*g1^2 + g3^2)*exp(g2)/20"), _NU_1,
    ),
    Case(
        "rest to equator", "integral", {"A": "17/10", "B": "7/5", "C": 1},
        {"type": "general", "F": "exp(-w)", "G": "-3*(6/10 - g2^2) + 3/10*g2"},
        {"type": "planar", "lambda": "11/10"}, stop="999/256",
    ),
)  # fmt: skip
