"""Proves for which λ motions exist: stretch by stretch of λ, with enclosed ends.

The half line of λ is cut into stretches; of each it is proved that there is a motion for every λ in
it (p² > 0 at one place v for all of them), or for none (p² < 0 for all of them on the whole curve,
by bounds in doubles). What is neither is halved. λ → 0 and λ → ∞ are stretches like the others.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.formula.tape import Tape
from service.dynamics.potentials.potential import NoClosedFormError, Potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import (
    CELL_MIN_RELATIVE_WIDTH,
    QUARTER_TURN,
    Cells,
    Loops,
    Shape,
    have_no_motion,
    loops_of_stretches,
    radicand_bounds,
    shape_of,
)

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

STRETCHES_PER_SIDE = 24
"""Stretches to begin with, towards 0 and towards ∞, each with the ratio 2 of its ends."""
STRETCH_MIN_RELATIVE_WIDTH = 1e-5
"""Relative width of a stretch that is not halved any more."""
END_RELATIVE_RADIUS = 1e-3
"""Relative radius up to which an unknown stretch between motions and none is an end."""
NEAREST_LAMBDA = 1e-12
"""A stretch next to 0 or ∞ that ends here is not cut again."""
CUT_PARTS = 8
MAX_OPEN_STRETCHES = 64
"""Open ones at a time: with more of them nothing is gained by halving."""
MAX_CELLS = 1024
REFINEMENTS, REFINEMENT_POINTS = 3, 13
"""How often, and with how many places, the neighbourhood of the best place is looked at again."""
SIGN_BITS = 128

State = Literal["motions", "none", "unknown"]


@dataclass(frozen=True, slots=True)
class CurveRange:
    """All λ between two ends; None is the end of the half line, 0 or ±∞."""

    lower: arb | None
    upper: arb | None


@dataclass(frozen=True, slots=True)
class Existence:
    """The ranges of λ, or nu, in which there are motions on the half of the curve that was asked.

    On all of ``motions`` there are some, outside of them and of ``undecided`` there are none. The
    ends are balls: the statements hold up to them.
    """

    name: Literal["lambda", "nu"]
    motions: tuple[CurveRange, ...]
    undecided: tuple[CurveRange, ...]


@dataclass(frozen=True, slots=True)
class _Piece:
    """low < k ≤ high, k being the primed λ or 1/λ."""

    is_inverse: bool
    low: float
    high: float
    state: State = "unknown"

    def cut(self) -> "list[_Piece]":
        """Return the parts of it, with equal ratios of their ends."""
        if self.low == 0.0:
            ends = [0.0, self.high / 16.0, self.high]
        else:
            ends = [*np.geomspace(self.low, self.high, CUT_PARTS + 1)[:-1].tolist(), self.high]
        return [_Piece(self.is_inverse, low, high) for low, high in pairwise(ends)]

    @property
    def is_small(self) -> bool:
        """Tell whether it is not to be cut."""
        return (
            self.high < NEAREST_LAMBDA
            if self.low == 0.0
            else self.high - self.low < STRETCH_MIN_RELATIVE_WIDTH * self.high
        )


def find_existence(
    body: RigidBody, potential: Potential, motion: PlanarMotion, is_late: Callable[[], bool] = lambda: False
) -> Existence | None:
    """Return the λ with motions; ``motion`` gives everything but λ. None for a V without a formula; A ≠ C.

    What is still open when it ``is_late`` is left undecided.
    """
    try:
        tape = potential.tape
    except NoClosedFormError:
        return None
    shape = shape_of(body, motion)
    waiting, done = _first_pieces(), list[_Piece]()
    while waiting:
        states = _states(tape, shape, waiting, is_late)
        following: list[_Piece] = []
        for piece, state in zip(waiting, states, strict=True):
            known = _Piece(piece.is_inverse, piece.low, piece.high, state)
            if state == "unknown" and not piece.is_small:
                following.append(known)
            else:
                done.append(known)
        if len(following) > MAX_OPEN_STRETCHES or is_late():
            done.extend(following)
            break
        waiting = [part for piece in following for part in piece.cut()]
    with ctx.workprec(SIGN_BITS):
        return _in_order(done, shape, motion)


def _first_pieces() -> list[_Piece]:
    ends = [0.0, *(2.0**-k for k in range(STRETCHES_PER_SIDE, -1, -1))]
    return [_Piece(inverse, low, high) for inverse in (False, True) for low, high in pairwise(ends)]


def _states(tape: Tape, shape: Shape, pieces: Sequence[_Piece], is_late: Callable[[], bool]) -> list[State]:
    states: list[State] = ["unknown"] * len(pieces)
    for inverse in (False, True):
        places = [k for k, piece in enumerate(pieces) if piece.is_inverse == inverse]
        if not places:
            continue
        low, high = (np.array([getattr(pieces[k], end) for k in places]) for end in ("low", "high"))
        loops = loops_of_stretches(shape, low, high, is_inverse=inverse)
        moving = _have_motions(tape, loops)
        rest = np.flatnonzero(~moving)
        # Cells much narrower than the stretch of λ add nothing.
        narrowest = np.clip((1.0 - low / high) / 8.0, CELL_MIN_RELATIVE_WIDTH, 1e-3)[rest]
        empty = have_no_motion(tape, loops.at(rest), MAX_CELLS, narrowest, is_late)
        for k in np.flatnonzero(moving).tolist():
            states[places[k]] = "motions"
        for k in rest[empty].tolist():
            states[places[k]] = "none"
    return states


def _have_motions(tape: Tape, loops: Loops) -> BoolArray:
    """Tell for each loop whether a place with p² > 0 for all λ of its stretch was found."""
    count = len(loops.Z[0])
    low, high = _places()
    both = np.concatenate([low, low]), np.concatenate([high, high])
    hemisphere = np.repeat([1.0, -1.0], len(low))
    moving = np.zeros(count, dtype=np.bool_)
    if not count:
        return moving
    found = _lowest(tape, loops, hemisphere, *(np.tile(end, (count, 1)) for end in both))
    moving |= (found > 0.0).any(axis=1)
    for sign in (1.0, -1.0):
        of_side = np.where(hemisphere == sign, found, -np.inf)
        best = np.argmax(of_side, axis=1)
        centre = both[1][best]
        # Neighbours are no farther than a quarter of a turn through the places, or a factor of 8.
        width = np.minimum(0.1, 0.9 * centre)
        for _ in range(REFINEMENTS):
            shares = np.linspace(-1.0, 1.0, REFINEMENT_POINTS)
            top = np.clip(centre[:, None] + width[:, None] * shares, 1e-12, QUARTER_TURN)
            values = _lowest(tape, loops, np.full(REFINEMENT_POINTS, sign), top * (1.0 - 1e-12), top)
            moving |= (values > 0.0).any(axis=1)
            centre = top[np.arange(count), np.argmax(values, axis=1)]
            width = width * (2.0 / (REFINEMENT_POINTS - 1.0))
    return moving


def _places() -> tuple[FloatArray, FloatArray]:
    """Return the places where a motion is looked for: next to the pole stretches, else points."""
    poles = 10.0 ** -np.array([32.0, 16.0, 8.0, 4.0, 2.0, 1.0])
    points = np.concatenate([np.geomspace(1e-8, 0.1, 12), np.linspace(0.1, QUARTER_TURN, 25)[1:]])
    low = np.concatenate([np.zeros(len(poles)), points * (1.0 - 1e-12)])
    return low, np.concatenate([poles, points])


def _lowest(
    tape: Tape, loops: Loops, hemisphere: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    """Return the lower bound of p², up to a factor, at places (loops, n); −∞ where there is none."""
    count, n = low.shape
    owner = np.repeat(np.arange(count), n)
    cells = Cells(owner, np.tile(hemisphere, count), low.ravel(), high.ravel())
    lo, hi = radicand_bounds(tape, loops, cells)
    return np.where(lo <= hi, lo, -np.inf).reshape(count, n)


def _in_order(pieces: Sequence[_Piece], shape: Shape, motion: PlanarMotion) -> Existence:
    """Join the pieces along λ or nu, and read off the ends."""
    small = sorted((piece for piece in pieces if not piece.is_inverse), key=lambda piece: piece.low)
    large = sorted((piece for piece in pieces if piece.is_inverse), key=lambda piece: -piece.low)
    runs = _runs(
        [
            *((piece.state, _value(piece.low), _value(piece.high)) for piece in small),
            *((piece.state, _inverse(piece.high), _inverse(piece.low)) for piece in large),
        ]
    )
    sent_nu = motion.nu is not None
    converted = [
        (state, _sent(lower, shape, motion), _sent(upper, shape, motion)) for state, lower, upper in runs
    ]
    if shape.is_mirrored != (sent_nu and motion.sign_of_g1 < 0):
        converted = [(state, upper, lower) for state, lower, upper in reversed(converted)]
    return _read(converted, "nu" if sent_nu else "lambda")


_Run = tuple[State, arb | None, arb | None]


def _value(k: float) -> arb | None:
    return arb(k) if k else None


def _inverse(k: float) -> arb | None:
    return 1 / arb(k) if k else None


def _sent(value: arb | None, shape: Shape, motion: PlanarMotion) -> arb | None:
    """Return λ or nu as it is sent, from the primed λ."""
    if value is None:
        return None
    own = (-ball(shape.alpha) * value.log()).exp() if shape.is_mirrored else value
    return own if motion.nu is None else own * own * motion.sign_of_g1


def _runs(pieces: Sequence[_Run]) -> list[_Run]:
    """Join neighbours of one state."""
    runs: list[_Run] = []
    for state, lower, upper in pieces:
        if runs and runs[-1][0] == state:
            runs[-1] = (state, runs[-1][1], upper)
        else:
            runs.append((state, lower, upper))
    return runs


def _read(runs: Sequence[_Run], name: Literal["lambda", "nu"]) -> Existence:
    """Return what the runs say; a narrow unknown one between motions and none is the ball of an end."""
    motions, undecided, ends = list[CurveRange](), list[CurveRange](), dict[int, arb]()
    for k, (state, lower, upper) in enumerate(runs):
        if state != "unknown":
            continue
        around = {runs[n][0] for n in (k - 1, k + 1) if 0 <= n < len(runs)}
        if lower is not None and upper is not None and len(around) == 2:
            enclosing = lower.union(upper)
            if enclosing.rad() < END_RELATIVE_RADIUS * abs(enclosing.mid()):
                ends[k] = enclosing
                continue
        undecided.append(CurveRange(lower, upper))
    for k, (state, lower, upper) in enumerate(runs):
        if state == "motions":
            motions.append(CurveRange(ends.get(k - 1, lower), ends.get(k + 1, upper)))
    return Existence(name, tuple(motions), tuple(undecided))
