"""The energy on a curve as it is printed, for every family: nothing here asks the code under test."""

from collections.abc import Sequence
from fractions import Fraction
from math import comb

from flint import arb

from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.parameters import bind
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from tests.conformance.specimens import Specimen


def ball(value: Fraction | int | str) -> arb:
    return BallAlgebra().constant(Fraction(value))


def energy(specimen: Specimen, lam: arb, s1: int, s3: int) -> arb:
    """Return h on |g3| = lam |g1|^(C/A), for the signs of g1 and g3."""
    potential, body = specimen.document["potential"], specimen.document["body"]
    A, C = Fraction(body["A"]), Fraction(body["C"])
    match potential["type"]:
        case "expression":
            return _evaluate(specimen.energy, {"lambda": lam, "s1": arb(s1), "s3": arb(s3)})
        case "gravity":
            if A == 2 * C:
                return -ball(potential["a"]) * s1 * lam**2 / 2
            # The mirror image: g1²/g3 = s3/λ.
            return -ball(potential["c"]) * s3 / lam / 2
        case "rational":
            return _rational(potential, s1 * lam**2)
        case "homogeneous":
            return _homogeneous(potential, A / C, lam)
        case "general":
            return _general(potential, A, C, lam, f"{_sign(s1)}{_sign(s3)}")
    raise AssertionError(potential)


def _rational(potential: dict, nu: arb) -> arb:
    h = -ball((_list(potential, "c") or [0])[0])
    for n, a in enumerate(_list(potential, "a"), start=1):
        h += (-1 if n == 3 else 1) * ball(a) * ball(n - Fraction(3, 2)) * nu ** (2 * n - 1)
    for n, b in enumerate(_list(potential, "b"), start=1):
        h -= comb(2 * n, n) * ball(b) / nu ** (2 * n)
    return h


def _homogeneous(potential: dict, alpha: Fraction, lam: arb) -> arb:
    a, h = ball(alpha), arb(0)
    for n, b in enumerate(_list(potential, "B")):
        h += (-1) ** n * ball(b) * (n * a - n - 1) / a * lam ** (2 * (n + 1))
    for n, c in enumerate(_list(potential, "C")):
        h += ball(c) * (n - (n + 1) * a) * lam ** (-2 * a * (n + 1))
    for n, factor in enumerate(_list(potential, "log")):
        if Fraction(factor):
            larger = max(alpha, 1 / alpha)
            m = Fraction(n + 1) / larger
            power = lam ** (2 * (n + 1)) if alpha > 1 else lam ** (-2 * a * (n + 1))
            h -= ball(factor) * ball(larger - 1) ** ball(m * (larger - 1)) * power
    return h


def _general(potential: dict, A: Fraction, C: Fraction, lam: arb, quadrant: str) -> arb:
    alpha = ball(A / C)
    w = ball(abs(A - C)) ** (alpha - 1) * lam ** (2 * alpha)
    text = potential.get("F") or potential[f"F_{quadrant}"]
    constants = {name: Fraction(value) for name, value in potential.get("parameters", {}).items()}
    return -_evaluate(text, {"w": w}, {**constants, "A": A, "C": C})


def _evaluate(text: str, values: dict[str, arb], constants: dict[str, Fraction] | None = None) -> arb:
    tree = bind(parse(text), constants or {}, variables=tuple(values))
    return compile_tape(tree, tuple(values)).evaluate(BallAlgebra(), tuple(values.values()))


def _list(potential: dict, name: str) -> Sequence:
    return potential.get(name, [])


def _sign(sign: int) -> str:
    return "p" if sign > 0 else "m"
