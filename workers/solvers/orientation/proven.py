r"""The attitude of a periodic planar motion, proven: by steps over one period, and by what it gains in each.

With n whole periods T before t, and the azimuths Δψ gained in one,

.. math:: \psi_k(t) = \psi_k(t - n T) + n\,\Delta\psi_k , \qquad
          q(t) = (\pm 1)^n e^{k n \Delta\psi_1 / 2} q(t - n T) ,

so late times cost no more than early ones.
"""

from dataclasses import replace
from functools import partial
from math import floor

from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.equations.orientation import LOCAL_QUATERNION, PRECESSION, about_vertical
from service.dynamics.motion import COLUMNS
from service.dynamics.problem import Problem
from workers.solvers.certified.certify import Certified, is_narrow
from workers.solvers.certified.errors import CertifiedUnavailableError
from workers.solvers.certified.validated.enclose import Start, enclose_at
from workers.solvers.certified.validated.motion import AXES, with_attitude
from workers.solvers.certified.validated.system import EulerPoisson, TurningBody

SPARE_BITS = 16
"""Bits that sums and products of the attitude may lose."""


def with_proven_attitude(
    problem: Problem, body: RigidBody, start: Start, proven: Certified, *, goes_round: bool
) -> Certified:
    """Return enclosures of a planar motion with those of its attitude, and of its precession.

    A motion that does not go round its curve goes to and fro: then nothing is gained in a period.

    Raises
    ------
    CertifiedUnavailableError
        The motion has no period, or steps do not prove its attitude.
    """
    if proven.period is None:
        raise CertifiedUnavailableError("it has no period")
    turns = [floor(float(time / proven.period)) for time in proven.times]
    bits = proven.bits + SPARE_BITS + max((abs(n).bit_length() for n in turns), default=0)
    with ctx.workprec(4 * bits):
        local = [time - n * proven.period for time, n in zip(proven.times, turns, strict=True)]
        axes = tuple(AXES[name] for name in PRECESSION)
        system = TurningBody(EulerPoisson(body, problem.potential.tape), axes)
        *there, last = enclose_at(system, partial(with_attitude, start, axes), [*local, proven.period], bits)
        gained = last[10:] if goes_round else (arb(0), arb(0))
        first = with_attitude(start, axes)[6:10]
        turned = zip(_turned_by(gained[0], first), last[6:10], strict=True)
        is_turned = float(sum((x * y for x, y in turned), arb(0))) < 0.0
        rows = []
        for n, state, row in zip(turns, proven.states, there, strict=True):
            quaternion = _turned_by(n * gained[0], row[6:10])
            sign = -1 if is_turned and n % 2 else 1
            angles = [psi + n * gain for psi, gain in zip(row[10:], gained, strict=True)]
            rows.append((*state, *(sign * x for x in quaternion), *angles))
    if not all(is_narrow(value, proven.bits) for row in [*rows, gained] for value in row):
        raise CertifiedUnavailableError(f"its attitude is not known to {proven.bits} bits")
    columns = (*COLUMNS, *LOCAL_QUATERNION, *PRECESSION)
    return replace(proven, states=tuple(rows), columns=columns, precession=(gained[0], gained[1]))


def _turned_by(angle: arb, quaternion: tuple[arb, ...]) -> tuple[arb, ...]:
    sine, cosine = (angle / 2).sin_cos()
    return about_vertical(cosine, sine, quaternion)
