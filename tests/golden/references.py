"""``python -m tests.golden.references``: all golden numbers without the service, in 100 s of a core.

Each entry of ``references.json`` tells how its numbers were found (``provenance``).
"""

import json
from concurrent.futures import ProcessPoolExecutor
from fractions import Fraction
from pathlib import Path

from flint import arb, ctx
from mpmath import mp, mpf

from tests.golden.by_quadrature import DIGITS, in_an_integral, through_the_pole
from tests.golden.by_taylor import AnyState, Planar, taylor
from tests.golden.motions import TAYLOR
from tests.support.taylor import BITS

FILE = Path(__file__).with_name("references.json")
TIMES = tuple(Fraction(each) for each in ("0", "1", "7/2", "1000"))
INTEGRALS = {"pole passed by convention": through_the_pole, "an integral": in_an_integral}

START = "start: the equator or a rest point, by mpmath; energy: theory.md, section 1, (1), at the start"
PROVENANCE = {
    "planar": f"{START}; period and states: Taylor integration of the six Euler-Poisson equations "
    "(tests/support/taylor.py), the first return to the start; return, energy and q = 0 hold to 1e-64",
    "collision": f"{START}; states: the same Taylor integration, two orders agree to 1e-64",
    "state": "energy: by its definition at the start; states: Taylor integration of the six "
    "Euler-Poisson equations (tests/support/taylor.py), two orders agree to 1e-64",
    "pole passed by convention": "energy and p: closed form, theory.md, sections 1 and 3; "
    "period and states: t(u) by mpmath.quad, inverted by mpmath.findroot, to 1e-48",
    "an integral": "energy: closed form h = -F(w), theory.md, section 6; period and states: V by mp.quad, "
    "the time by its cosine series whose last terms are below 1e-48",
}


def reference(name: str) -> dict[str, object]:
    """Return period, energy and states (p, q, r, g1, g2, g3) by their exact times, as decimals."""
    if name in INTEGRALS:
        with mp.workdps(DIGITS):
            found = INTEGRALS[name](TIMES)
            return _entry(PROVENANCE[name], found.period, found.energy, found.states)
    motion = TAYLOR[name]
    with ctx.workprec(BITS):
        numbers = taylor(motion)
        return _entry(PROVENANCE[_kind(motion)], numbers.period, numbers.energy, numbers.states)


def _kind(motion: Planar | AnyState) -> str:
    if isinstance(motion, AnyState):
        return "state"
    return "planar" if motion.is_periodic else "collision"


def _entry(
    provenance: str, period: object, energy: object, states: dict[Fraction, list]
) -> dict[str, object]:
    return {
        "provenance": provenance,
        "period": None if period is None else _decimal(period),
        "energy": _decimal(energy),
        "states": {str(t): [_decimal(each) for each in state] for t, state in states.items()},
    }


def _decimal(value: arb | mpf) -> str:
    """Return 62 decimals after the point of a ball's midpoint, 46 of a number of mpmath."""
    if isinstance(value, arb):
        mantissa, exponent = (int(each) for each in value.mid().man_exp())
        return _fixed(mantissa * Fraction(2) ** exponent, 62)
    return _fixed(Fraction(mp.nstr(value, 50)), 46)


def _fixed(value: Fraction, places: int) -> str:
    units = round(abs(value) * 10**places)
    sign = "-" if value < 0 and units else ""
    return f"{sign}{units // 10**places}.{units % 10**places:0{places}d}"


def main() -> None:
    names = [*TAYLOR, *INTEGRALS]
    with ProcessPoolExecutor(2) as pool:
        found = dict(zip(names, pool.map(reference, names), strict=True))
    FILE.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
