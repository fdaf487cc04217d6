"""The matrix of a rotation that a quaternion states."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def rotation_matrix(quaternion: FloatArray) -> FloatArray:
    """Return R, shape (..., 3, 3), of unit quaternions, shape (..., 4)."""
    q0, q1, q2, q3 = np.moveaxis(quaternion, -1, 0)
    rows = [
        [q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3, 2 * (q1 * q2 - q0 * q3), 2 * (q1 * q3 + q0 * q2)],
        [2 * (q1 * q2 + q0 * q3), q0 * q0 - q1 * q1 + q2 * q2 - q3 * q3, 2 * (q2 * q3 - q0 * q1)],
        [2 * (q1 * q3 - q0 * q2), 2 * (q2 * q3 + q0 * q1), q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
