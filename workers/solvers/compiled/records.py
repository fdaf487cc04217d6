"""The records that kernels work on: every number has a name, in Python as in compiled code.

A class here says what a record holds, for readers and for the type checker; the constant of the same name
in capitals is its layout. Records lie in arrays that Python has made: compiled code keeps no reference from a
record to the array it lies in, and would free one that it has made itself too early.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Records = NDArray[np.void]
"""An array of records; each has its numbers as attributes, named unlike those that all of numpy's have."""
NODES = 16
"""Number of nodes of a series of dt/du on a panel."""
MAX_PANELS = 192
MAX_ARCS = 64
MAX_ROOTS = 35


class Instructions(NamedTuple):
    """The operations of a program, see :class:`.Program`, and the registers of its results, int64."""

    code: IntArray
    results: IntArray


class Discs(NamedTuple):
    """Rows of discs, shapes (rows, LANES) and (rows,): see :mod:`compiled.discs.rows`."""

    centres: FloatArray
    radii: FloatArray
    powers: FloatArray
    """NaN for a row that is 0 everywhere."""


class Formula(NamedTuple):
    """A program with its constants, and what it is worked out on."""

    code: IntArray
    result: int
    turn: Instructions
    """See :class:`.Program`."""
    constants: FloatArray
    lows: FloatArray
    """Low parts that the doubles of the constants leave out."""
    registers: FloatArray
    """Registers of ``turn``: shape (2, registers, POINTS), see :func:`.interpreter.new_registers`."""
    discs: Discs
    harmonics: FloatArray
    """Cosine series of dt/du in πu, where dt/du is known by that; else empty."""


class Equations(NamedTuple):
    """The six equations of a body in a potential."""

    gradient: Instructions
    """See :class:`.Program`."""
    constants: FloatArray
    moments: FloatArray
    """A, B, C, B − C, C − A, A − B."""


class Start(NamedTuple):
    """The start that is asked of a motion."""

    kind: int
    """AUTOMATIC, EQUATOR, REST or POINT."""
    s_sign: float
    g2_sign: float
    sine: float
    """|sin v| of a point."""


class Loop:
    """A loop, an orbit on it, and its start."""

    alpha: float
    """A/C > 1."""
    factor: float
    """C/((A − C) A)."""
    sign1: float
    """Sign of the primed g1."""
    mirrored: bool
    half: float
    """Sign of the primed g3."""
    window: int
    """−1: the only one."""
    kind: int
    s_sign: float
    g2_sign: float
    """The start that is asked: see :class:`Start`."""
    size_of_g1: float
    """The client's |g1| at a point where the motion is asked to start."""
    log_lambda: float
    """Primed."""
    alpha_low: float
    factor_low: float
    log_lambda_low: float
    """Low parts that the doubles of these leave out; 0 where nobody asks for them."""
    z: float
    g: float
    rotates: bool
    half_width: float
    """(v₊ − v₋)/2."""
    s_lower: float
    c_lower: float
    s_middle: float
    c_middle: float
    s_upper: float
    c_upper: float
    """Sine and cosine at the ends and in the middle."""
    direction: float
    """Direction of a rotation."""
    place: float
    """v at the start, unrolled, as far as doubles tell; only where zeros of P were looked for."""
    start: float
    """u at the start; NaN: not decided."""
    sense: float
    """Direction in which u goes at first."""
    period_hi: float
    period_lo: float
    origin: float
    origin_lo: float
    """The time from u = 0 (or from u = 1 back, if ``backwards``) to the start, in two parts."""
    backwards: bool
    by_roots: bool
    """P is known by its roots: see :func:`.factor_by_roots`."""
    leading: float
    mu: float
    ends: int
    reals: int
    pairs: int
    roots: FloatArray


class Panel:
    """A panel of the time map: u = anchor/2 + w, where −1 ≤ x ≤ 1 is low ≤ w ≤ high.

    About a rest point dt/du is even: the panel is half of one symmetric about it, so that no node is next to
    it, where rounding is divided by the distance.
    """

    anchor: int
    low: float
    high: float
    first: float
    last: float
    """The panel is first ≤ x ≤ last."""
    start: float
    start_lo: float
    """The time at ``first``, in two parts."""
    slopes: FloatArray
    """Series of dt/dx."""
    times: FloatArray
    """Series of t − start."""
    length: float
    """Time on the panel."""
    guess: FloatArray
    """x as a quintic of the share of ``length`` that has passed: its Newton form, the middle node last."""
    proved: float
    """Bound of the relative departure of the series of dt/dx on the whole panel; NaN: not proved."""


class Cut:
    """A panel that is not built yet, or that must be halved."""

    anchor: int
    low: float
    high: float
    first: float
    last: float
    before: float
    """The tail before it was halved."""


class Arc:
    """An arc of the loop with P > 0; |v| is unrolled from the half that is asked, from below 0 to above π."""

    lo: float
    hi: float
    lo_rests: bool
    hi_rests: bool
    """Whether they are rest points."""
    reach: float
    """The largest |sin v|."""
    window: int


class Found:
    """The results for a solved motion; NaN where it was not decided."""

    panels: int
    """Number of panels of the time map; 0: not decided."""
    period: float
    period_error: float
    time_error: float
    """Error of a time within one period, at the start of each panel."""
    speed: float
    """Largest time derivative of any variable."""
    largest: float
    """Largest |p| or |r|."""
    rate_error: float
    """Relative, of dt/du."""
    moved: float
    """Error of a variable by what times are off besides, each on its panel."""


def layout(view: type, **shapes: int | tuple[int, ...]) -> np.dtype[np.void]:
    """Return the layout of the records that ``view`` describes, its arrays being of these shapes."""
    numbers: dict[object, object] = {float: np.float64, int: np.int64, bool: np.bool_}
    fields: list[tuple[object, ...]] = []
    for name, kind in view.__annotations__.items():
        if kind in numbers:
            fields.append((name, numbers[kind]))
        else:
            fields.append((name, np.float64, shapes[name]))
    return np.dtype((np.record, fields), align=True)


def rows(view: type, width: int) -> np.dtype[np.void]:
    """Return the layout of records of which every field is a row of this width."""
    return layout(view, **dict.fromkeys(view.__annotations__, width))


LOOP = layout(Loop, roots=(MAX_ROOTS, 2))
PANEL = layout(Panel, slopes=NODES, times=NODES + 1, guess=7)
CUT, ARC, FOUND = layout(Cut), layout(Arc), layout(Found)


def new_records(layout: np.dtype[np.void], count: int = 1) -> Records:
    """Return records that are not filled in; numpy takes several times longer for other than bytes."""
    return np.empty(count * layout.itemsize, dtype=np.uint8).view(layout)


def copied(records: Records, times: int = 1) -> Records:
    """Return so many copies, one after the other, made of the bytes: numpy would copy number by number."""
    return np.frombuffer(bytearray(records.tobytes() * times), dtype=records.dtype)


class Gradient(NamedTuple):
    """The gradient of a potential as operations on registers; see :mod:`.general.steps`."""

    code: IntArray
    """Shape (operations, 4)."""
    constants: FloatArray
    gradient: IntArray
    """The registers of V_1, V_2, V_3, and for each whether it is a constant."""
    registers: int


class Models(NamedTuple):
    """Bodies and potentials of one structure: a formula, its gradient, and numbers of each model.

    The second constants and moments are those of a problem that rounded numbers might as well have meant.
    """

    program: Instructions
    """V and its gradient, see :class:`workers.solvers.compiled.evaluation.program.Program`."""
    slopes: IntArray
    gradient: IntArray
    registers: int
    """The gradient, as :class:`Gradient` has it."""
    constants: FloatArray
    """Constants of the program, shape (models, constants)."""
    slope_constants: FloatArray
    other_slope_constants: FloatArray
    """Constants of the gradient's operations, shape (models, constants)."""
    moments: FloatArray
    other_moments: FloatArray
    """A, B, C, B − C, C − A, A − B, shape (models, 6)."""


class Asked(NamedTuple):
    """The request to two runs: times, tolerances and limits."""

    first: float
    last: float
    """The times from ``first`` ≤ 0 to ``last`` ≥ 0."""
    fine: float
    coarse: float
    """Local tolerances of the runs."""
    max_steps: int
    collapsed: float
    """A step this much shorter than the longest one ends a run."""
    singular: float
    """Growth of the potential's gradient from the beginning of such a run that tells a singularity."""
    before_the_end: float
    """Share of the time of such a run of which nothing is asked."""
    tolerance: float
    safety: float
    """On the difference of the runs."""
    rounding: float
    """Error that the runs share, relative to the variables."""
    noise: float
    """Error of a step by rounding, relative to what it adds up."""
    tail: float
    """Truncation error of a step of the finer run, relative to the last terms: see :mod:`.general.growth`."""
    fine_defect: float
    coarse_defect: float
    """Largest residuals of a step in the equations, relative to the largest variable."""
    goal: float
    """Share of the error that the truncation of F may be."""
    finest: float
    """Least truncation asked for, beside variables of the size 1."""
    is_last: bool
    """Whether no finer runs follow if these are not accurate enough."""
