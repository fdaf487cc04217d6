"""An independent attitude: everything integrated at once by Taylor series."""

from typing import NamedTuple

import heyoka
import numpy as np

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.real import nearest_double
from service.dynamics.potentials.potential import Potential
from tests.support.heyoka_integrator import HeyokaAlgebra


class Witness(NamedTuple):
    variables: np.ndarray
    quaternion: np.ndarray
    psi1: np.ndarray
    psi3: np.ndarray


def witness(body: RigidBody, potential: Potential, state, quaternion, times) -> Witness:
    """Integrate variables, quaternion and azimuths from t = 0 to the growing ``times`` at once.

    Where an azimuth has no meaning its column is spoilt, and not to be looked at.
    """
    p, q, r, g1, g2, g3, *e = names = heyoka.make_vars(
        "p", "q", "r", "g1", "g2", "g3", "e0", "e1", "e2", "e3", "psi1", "psi3"
    )
    V = potential.tape.evaluate(HeyokaAlgebra(nearest_double), (g1, g2, g3))
    V1, V2, V3 = heyoka.diff_tensors([V], [g1, g2, g3]).gradient
    A, B, C = float(body.A), float(body.B), float(body.C)
    rates = [
        ((B - C) * q * r + g2 * V3 - g3 * V2) / A,
        ((C - A) * p * r + g3 * V1 - g1 * V3) / B,
        ((A - B) * p * q + g1 * V2 - g2 * V1) / C,
        r * g2 - q * g3,
        p * g3 - r * g1,
        q * g1 - p * g2,
        -0.5 * (p * e[1] + q * e[2] + r * e[3]),
        0.5 * (p * e[0] + r * e[2] - q * e[3]),
        0.5 * (q * e[0] + p * e[3] - r * e[1]),
        0.5 * (r * e[0] + q * e[1] - p * e[2]),
        (q * g2 + r * g3) / (g2 * g2 + g3 * g3),
        (p * g1 + q * g2) / (g1 * g1 + g2 * g2),
    ]
    tilts = {10: np.hypot(state[4], state[5]), 11: np.hypot(state[3], state[4])}
    keep = [*range(10), *(k for k, tilt in tilts.items() if tilt > 1e-5)]
    stepper = heyoka.taylor_adaptive(
        [(names[k], rates[k]) for k in keep],
        [*state, *quaternion, *[0.0] * (len(keep) - 10)],
        tol=1e-18,
        high_accuracy=True,
        compact_mode=True,
        opt_level=0,
    )
    rows = stepper.propagate_grid(np.asarray(times, dtype=float))[-1]
    return Witness(rows[:, :6], rows[:, 6:10], rows[:, 10], rows[:, -1])
