"""Random motions of every sort, with their attitude, and multipliers: claims against doubled series.

Chaotic bodies, tops next to the upright one, fast spins, fields that are nearly singular, moments that are
nearly equal or far apart, planar motions for their attitude and for their multipliers, all classical cases.
The document is solved as a job is, and all that it claims is compared: the samples of ω and γ, the stored
function of time, the quaternion and the angles. References are :mod:`tests.support.doubled_series`, from
the exact state; of planar motions from a proven one. What the service says of the state of a classical case
at t = 0 is taken from it: the conformance of the cases proves that.
"""

import json
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from math import ceil, sqrt
from typing import Any, Literal, get_args

import numpy as np
from flint import acb, arb, ctx

from service.dynamics.equations.orientation import (
    PRECESSION,
    QUATERNION,
    trajectory_columns,
    trajectory_errors,
)
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.motion import COLUMNS
from service.dynamics.problem import PlanarMotion, Tier
from service.jobs.records import Refused
from service.schemas.problem.problem import read_problem
from service.storage.codecs.packing import decode_arrays, decode_dense
from tests.conformance.classical.specimens import FREE, NAMES, example, placed, random_documents
from tests.support import doubled_series
from tests.support.claims import UNSEEN, Claim
from tests.support.doubled_series import Term
from tests.support.random_documents import draw_problem, with_times
from tests.support.random_states import (
    Moments,
    point_near,
    random_direction,
    random_moments,
    unit_vector,
    written,
)
from workers.computation.compute import solve_document
from workers.solvers.choose import enclose

Kind = Literal[
    "chaotic",
    "near upright",
    "fast spin",
    "nearly singular",
    "nearly equal moments",
    "extreme moments",
    "planar",
    "classical",
    "multipliers",
]
KINDS: tuple[Kind, ...] = get_args(Kind)
MOST_RADIANS = 300.0
"""Turns of a fast spin, which its reference follows one by one."""
FASTEST = 1e4
MOST_SECONDS = 10.0
"""Processor time after which a problem is given up, and counted as refused."""
LATEST = 30.0
COMPARED_BITS = 256
"""Precision of comparisons: more than the digits of references."""
CLOSED = Fraction(1, 10**18)
"""Distance within which references of periodic motions come back: beyond it they are on another motion."""
START_BITS = 150
"""Bits of the proven state from which the reference of a planar motion starts."""
Setting = tuple[Moments, list[Term], Sequence[Fraction], Sequence[Fraction], float]
"""Moments, terms of V, ω, γ, and the latest time."""


class RefusedError(DynamicsError):
    """The document is refused as a job would be."""

    def __init__(self, error: Mapping[str, Any]) -> None:
        super().__init__(str(error["detail"]))
        self.code = error["code"]


@dataclass(frozen=True)
class MotionCase:
    """A motion, and what is true of it."""

    kind: Kind
    base: dict[str, Any]
    times: list[float]
    reference: list[list[Fraction]]
    """The six variables and the turn at the times; or nothing but the trace of the multipliers, -4."""
    about: str

    def document(self, tier: Tier) -> dict[str, Any]:
        """Return the whole document that asks a tier for it."""
        return with_times(self.base, [repr(t) for t in self.times], tier)

    def claims(self, tier: Tier) -> list[Claim]:
        """Solve the case and compare; raises RefusedError."""
        with _limited():
            outcome = solve_document(json.dumps(self.document(tier)), read=read_problem)
        if isinstance(outcome, Refused):
            raise RefusedError(outcome.error)
        if self.kind == "multipliers":
            stability = outcome.summary["stability"]
            if stability is None:
                raise RefusedError({"code": "stability_undefined", "detail": "no multipliers"})
            return _of_multipliers(stability, self.reference)
        dense, stored = decode_dense(outcome.dense), decode_arrays(outcome.samples)
        groups = outcome.summary["errors"]
        claimed = {name: groups["omega" if name in COLUMNS[:3] else "gamma"]["absolute"] for name in COLUMNS}
        own = {**dict.fromkeys(QUATERNION, "quaternion"), **{name: name for name in PRECESSION}}
        turned = {name: groups[group]["absolute"] for name, group in own.items() if group in groups}
        times = np.array(self.times)
        low = stored["t"] - times
        assert not low.any()
        evaluated, errors = trajectory_columns(dense, times), trajectory_errors(dense, times)
        with ctx.workprec(COMPARED_BITS):
            truth = _truth(self.reference, stored)
            return [
                _worst("samples", claimed, stored, truth),
                _worst("stored", {name: errors[name] for name in COLUMNS}, evaluated, truth),
                *([_worst("attitude", turned, stored, truth)] if turned else []),
            ]


@contextmanager
def _limited() -> Iterator[None]:
    """Refuse what takes longer than MOST_SECONDS of processor time."""

    def stop(*_: object) -> None:
        raise RefusedError({"code": "time limit", "detail": f"more than {MOST_SECONDS} s"})

    before = signal.signal(signal.SIGVTALRM, stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, MOST_SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, before)


def draw_motion(kind: Kind, draws: np.random.Generator) -> MotionCase:
    """Draw a motion and times, and find where it is, or what its multipliers are; raises RefusedError."""
    with _limited():
        try:
            return _drawn(kind, draws)
        except doubled_series.TooManyStepsError as fault:
            raise RefusedError({"code": "too many steps", "detail": "of the reference"}) from fault


def _drawn(kind: Kind, draws: np.random.Generator) -> MotionCase:
    if kind in ("planar", "multipliers"):
        return _planar(kind, draws)
    if kind == "classical":
        return _classical(draws)
    moments, terms, omega, gamma, last = _SETTINGS[kind](draws)
    A, B, C = map(str, moments)
    document = {
        "body": {"A": A, "B": B, "C": C, "allow_unphysical": True},
        "potential": {"type": "expression", "expression": written(terms)},
        "motion": {"type": "state", "omega": [*map(str, omega)], "gamma": [*map(str, gamma)]},
        "outputs": ["gamma", "omega", "orientation"],
    }
    return _followed(kind, document, moments, terms, (*omega, *gamma), last, draws)


def _followed(
    kind: Kind,
    document: dict[str, Any],
    moments: Moments,
    terms: Sequence[Term],
    state: tuple[Fraction, ...],
    last: float,
    draws: np.random.Generator,
    about: str = "",
) -> MotionCase:
    sign = 1.0 if draws.random() < 0.8 else -1.0
    times = [0.0, *(sign * float(each) for each in sorted([last, *draws.uniform(0.0, last, 3)]))]
    motion = doubled_series.Motion(moments, tuple(terms))
    reference = motion.turned(state, [Fraction(repr(t)) for t in times])
    return MotionCase(kind, document, times, reference, about or ("backwards" if sign < 0.0 else "forwards"))


def _number(low: float, high: float, draws: np.random.Generator) -> Fraction:
    return Fraction(f"{draws.uniform(low, high):.4g}")


def _power(low: float, high: float, draws: np.random.Generator) -> Fraction:
    return Fraction(f"{10.0 ** draws.uniform(low, high):.4g}")


def _linear(draws: np.random.Generator) -> list[Term]:
    return [(_number(-2, 2, draws), *unit_vector(axis)) for axis in range(3)]


def _quadratic(draws: np.random.Generator) -> list[Term]:
    return [(_number(-2, 2, draws), *(2 * n for n in unit_vector(axis))) for axis in range(2)]


def _spins(size: float, draws: np.random.Generator) -> list[Fraction]:
    return [_number(-size, size, draws) for _ in range(3)]


def _anywhere(draws: np.random.Generator) -> tuple[Fraction, ...]:
    return point_near(random_direction(draws), 1.0, draws)


def _chaotic(draws: np.random.Generator) -> Setting:
    terms = _linear(draws) + _quadratic(draws)
    terms += [(_number(-1, 1, draws), 1, 1, 1)] if draws.random() < 0.5 else []
    return (
        random_moments(draws),
        terms,
        _spins(2.0, draws),
        _anywhere(draws),
        float(draws.uniform(1.0, LATEST)),
    )


def _near_upright(draws: np.random.Generator) -> Setting:
    moments = random_moments(draws)
    if draws.random() < 0.5:
        moments = (moments[0], moments[0], moments[2])
    strength = _number(0.3, 3.0, draws)
    critical = 2.0 * sqrt(float(strength * max(moments[:2]))) / float(moments[2])
    # Nearer than VERTICAL_ANGLE there is no azimuth.
    gap = 10.0 ** draws.uniform(-6, -0.5)
    omega = [
        _number(-gap, gap, draws),
        _number(-gap, gap, draws),
        _number(-2 * critical, 2 * critical, draws),
    ]
    return (
        moments,
        [(strength, 0, 0, 1)],
        omega,
        point_near((0, 0, 1), gap, draws),
        float(draws.uniform(1, 15)),
    )


def _fast_spin(draws: np.random.Generator) -> Setting:
    moments, turn = random_moments(draws), float(_power(1.5, 4.0, draws))
    axis, omega = int(draws.integers(3)), _spins(0.1 * turn * float(draws.random() < 0.5) + 1.0, draws)
    omega[axis] = Fraction(f"{min(turn, FASTEST):.6g}")
    return (
        moments,
        _linear(draws),
        omega,
        _anywhere(draws),
        float(draws.uniform(0.1, 1.0)) * MOST_RADIANS / turn,
    )


def _nearly_singular(draws: np.random.Generator) -> Setting:
    axis, power = int(draws.integers(3)), int(draws.choice([-1, -2, -2, -4]))
    while True:
        gamma = _anywhere(draws)
        if abs(gamma[axis]) > Fraction(1, 4):
            break
    # It repels from the equator of the axis, where γ would reach it.
    wall = _power(-6.0, -1.0, draws) * (1 if power % 2 == 0 or gamma[axis] > 0 else -1)
    terms = [*_linear(draws), (wall, *(power * n for n in unit_vector(axis)))]
    return random_moments(draws), terms, _spins(1.5, draws), gamma, float(draws.uniform(0.5, 3.0))


def _nearly_equal(draws: np.random.Generator) -> Setting:
    gap, size = 10.0 ** draws.uniform(-12, -2), _number(0.5, 3.0, draws)
    moments = [size * (1 + Fraction(f"{gap * float(draws.uniform(-1, 1)):.6e}")) for _ in range(3)]
    if draws.random() < 0.3:
        moments[1] = moments[0]
    terms = _linear(draws) + (_quadratic(draws) if draws.random() < 0.5 else [])
    three = moments[0], moments[1], moments[2]
    return three, terms, _spins(2.0, draws), _anywhere(draws), float(draws.uniform(1.0, 20.0))


def _extreme(draws: np.random.Generator) -> Setting:
    three = _power(-3, 3, draws), _power(-3, 3, draws), _power(-3, 3, draws)
    omega = [spin / _square_root(moment) for spin, moment in zip(_spins(1.0, draws), three, strict=True)]
    fastest = max(abs(float(each)) for each in omega) + sqrt(1.0 / float(min(three)))
    return three, _linear(draws), omega, _anywhere(draws), float(draws.uniform(1.0, 60.0)) / fastest


def _square_root(number: Fraction) -> Fraction:
    return Fraction(f"{sqrt(float(number)):.4g}")


_SETTINGS: Mapping[Kind, Callable[[np.random.Generator], Setting]] = {
    "chaotic": _chaotic,
    "near upright": _near_upright,
    "fast spin": _fast_spin,
    "nearly singular": _nearly_singular,
    "nearly equal moments": _nearly_equal,
    "extreme moments": _extreme,
}


def _planar(kind: Kind, draws: np.random.Generator) -> MotionCase:
    drawn = draw_problem("three-term", draws)
    document = {**drawn.document, "body": dict(drawn.document["body"])}
    A, C = (Fraction(document["body"][name]) for name in "AC")
    least, most = abs(A - C), A + C
    B = least + (most - least) * _number(0.02, 0.98, draws)
    document["body"]["B"] = str(B)
    what = "stability" if kind == "multipliers" else "orientation"
    document["outputs"] = ["gamma", "omega", what]
    potential = document["potential"]
    given = potential.get("parameters", {})
    a, b, c = (Fraction(given.get(f"{n}1", "0") if given else potential[n][0]) for n in "abc")
    axes = (2, 0) if A < C else (0, 2)
    terms: list[Term] = [
        (a, *unit_vector(axes[0])),
        (b, *(-2 * n for n in unit_vector(axes[1]))),
        (c, *(2 * n for n in unit_vector(axes[0]))),
        (-c, 0, 2, 0),
    ]
    problem = read_problem(with_times(document, ["0"], "standard"))
    assert isinstance(problem.motion, PlanarMotion)
    proven = enclose(problem.body, problem.potential, problem.motion, [Fraction(0)], START_BITS)
    state, period = tuple(map(_exact, proven.states[0])), _exact(proven.period)
    moments = (A, B, C)
    about = " to ".join(drawn.window.ends)
    periods = float(draws.uniform(0.1, 2.0)) if kind == "planar" else 1.0
    motion = doubled_series.Motion(moments, tuple(terms))
    (after,) = motion.at(state, [ceil(periods) * period])
    if max(abs(one - other) for one, other in zip(after, state, strict=True)) > CLOSED:
        raise RefusedError({"code": "reference lost", "detail": "neighbours part too far in so many periods"})
    if kind == "planar":
        return _followed(kind, document, moments, terms, state, float(period) * periods, draws, about)
    carried = motion.carried(state, period)
    trace = sum(row[n] for n, row in enumerate(carried)) - 4
    return MotionCase(kind, document, [0.0], [[trace]], about)


def _classical(draws: np.random.Generator) -> MotionCase:
    name = str(draws.choice(NAMES))
    if name in FREE:
        (document,) = random_documents(name, int(draws.integers(1 << 30)), 1)
    else:
        document = example(name)
        document["motion"] = {**document["motion"], "phase": repr(round(float(draws.uniform()), 6))}
    document = {**document, "outputs": ["gamma", "omega", "orientation"]}
    there = placed(document)
    terms = [(each, *unit_vector(axis)) for axis, each in enumerate(there.motion.centre) if each]
    body = there.body
    assert body.B is not None
    state = (*there.start.omega, *there.start.gamma)
    last = float(draws.uniform(0.5, 15.0))
    return _followed("classical", document, (body.A, body.B, body.C), terms, state, last, draws, name)


def _exact(value: arb) -> Fraction:
    # A ball's middle is m 2^e.
    mantissa, exponent = value.mid().man_exp()
    return Fraction(int(mantissa)) * Fraction(2) ** int(exponent)


def _worst(
    name: str, claimed: Mapping[str, float], found: Mapping[str, np.ndarray], truth: Mapping[str, list[arb]]
) -> Claim:
    """Return the claim of which most is used up."""
    worst: Claim | None = None
    for column, bound in claimed.items():
        size = max(1.0, float(np.abs(found[column]).max()))
        apart = max(
            _apart(column, value, exact)
            for value, exact in zip(found[column].tolist(), truth[column], strict=True)
        )
        actual = max(UNSEEN * size, apart)
        claim = Claim(name, bound, actual, not actual <= bound)
        # A claim of 0 leaves nothing.
        if worst is None or claim.claimed * worst.actual < worst.claimed * claim.actual:
            worst = claim
    assert worst is not None
    return worst


def _apart(column: str, value: float, exact: arb) -> float:
    left = arb(value) - exact
    if column in PRECESSION:
        left -= 2 * arb.pi() * ((left / (2 * arb.pi())).mid() + arb(0.5)).floor()
    return float(abs(left).mid())


def _truth(reference: list[list[Fraction]], stored: Mapping[str, np.ndarray]) -> dict[str, list[arb]]:
    """Return the columns at the times, the angles up to whole turns."""
    rows = [[ball(number) for number in row] for row in reference]
    columns = {name: [row[k] for row in rows] for k, name in enumerate(COLUMNS)}
    # An exact one: the azimuth of a ball on the cut of atan2 may be any.
    first = [part.mid() for part in _attitude([row.mid() for row in rows[0][3:6]])]
    if QUATERNION[0] in stored:
        # Both signs are the same attitude; the sign at t = 0 is kept.
        side = (
            1
            if sum(float(x) * float(stored[n][0]) for x, n in zip(first, QUATERNION, strict=True)) > 0
            else -1
        )
        turned = [[side * x for x in _product(first, row[6:])] for row in rows]
        columns |= {name: [row[k] for row in turned] for k, name in enumerate(QUATERNION)}
        for name, axis in zip(PRECESSION, (0, 2), strict=True):
            azimuths = [_azimuth(row, axis) for row in turned]
            columns[name] = [angle - azimuths[0] for angle in azimuths]
    return columns


def _product(one: Sequence[arb], other: Sequence[arb]) -> list[arb]:
    a, b, c, d = one
    w, x, y, z = other
    return [
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    ]


def _attitude(gamma: Sequence[arb]) -> list[arb]:
    """Return the turn that takes the body's axes to space, the first horizontally onto the first of space."""
    g1, g2, g3 = gamma
    level = (g2 * g2 + g3 * g3).sqrt()
    # About the first axis until the vertical is in its plane with the third, then about the second.
    roll, tilt = arb.atan2(g2, g3) / 2, arb.atan2(-g1, level) / 2
    about_first, about_second = (
        [roll.cos(), roll.sin(), arb(0), arb(0)],
        [tilt.cos(), arb(0), tilt.sin(), arb(0)],
    )
    return _product(about_second, about_first)


def _azimuth(turn: Sequence[arb], axis: int) -> arb:
    w, x, y, z = turn
    if axis == 0:
        return arb.atan2(2 * (x * y + w * z), w * w + x * x - y * y - z * z)
    return arb.atan2(2 * (y * z - w * x), 2 * (x * z + w * y))


def _of_multipliers(stability: Mapping[str, Any], reference: list[list[Fraction]]) -> list[Claim]:
    with ctx.workprec(COMPARED_BITS):
        trace = ball(reference[0][0])
        root = (acb(trace * trace - 4)).sqrt()
        larger, smaller = sorted(((trace + root) / 2, (trace - root) / 2), key=lambda m: -float(abs(m)))
        found = [acb(*part) for part in stability["multipliers"]]
        actual = min(
            max(float(abs(one - m)) for one, m in zip(found, order, strict=True))
            for order in ((larger, smaller), (smaller, larger))
        )
        off = float(abs(arb(stability["trace"]) - trace))
        size = max(1.0, abs(float(trace)))
    pairs = {"trace": (stability["error"], off), "multipliers": (stability["multipliers_error"], actual)}
    return [
        Claim(name, claimed, max(UNSEEN * size, apart), not max(UNSEEN * size, apart) <= claimed)
        for name, (claimed, apart) in pairs.items()
    ]
