"""Tells whether V is a sum of low powers, which have no features much narrower than the sphere."""

import numpy as np

from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.records import Formula

HIGHEST = 12.0
"""Degree, of either sign, of the products of g1, g2 and g3 that V is a sum of."""
_LOW, _HIGH, _TERMS, _HAS_G2, _VARIES = range(5)


@kernel
def is_of_low_degree(
    formula: Formula,
) -> bool:
    """Say whether V is a sum of products of real powers of g1 and g3 and whole powers of g2, of low degree.

    A feature of such a V is about as wide as the sphere over its degree, and leaves its trace in the last
    coefficients of a series. A quotient by a sum, a function or a high power may make one of any width, but
    those of numbers are numbers.
    """
    code, constants = formula.code, formula.constants
    known = np.zeros((code.shape[0] + 3, 5))
    for k in range(3):
        known[k, _LOW], known[k, _HIGH], known[k, _TERMS], known[k, _VARIES] = 1.0, 1.0, 1.0, 1.0
    known[1, _HAS_G2] = 1.0
    for k in range(code.shape[0]):
        operation, i, j, slot = code[k, 0], code[k, 1], code[k, 2], code[k, 3]
        here = known[3 + k]
        if operation != 0:
            here[_VARIES] = known[i, _VARIES]
            if 1 <= operation <= 4 or operation == 7:
                here[_VARIES] = max(here[_VARIES], known[j, _VARIES])
        if here[_VARIES] == 0.0:
            here[_TERMS] = 1.0
            continue
        left = known[i]
        if operation == 1 or operation == 2:
            right = known[j]
            here[_LOW], here[_HIGH] = min(left[_LOW], right[_LOW]), max(left[_HIGH], right[_HIGH])
            here[_TERMS] = 2.0
            here[_HAS_G2] = max(left[_HAS_G2], right[_HAS_G2])
        elif operation == 3:
            right = known[j]
            here[_LOW], here[_HIGH] = left[_LOW] + right[_LOW], left[_HIGH] + right[_HIGH]
            here[_TERMS] = max(left[_TERMS], right[_TERMS])
            here[_HAS_G2] = max(left[_HAS_G2], right[_HAS_G2])
        elif operation == 4:
            right = known[j]
            if right[_TERMS] > 1.0 or right[_HAS_G2] > 0.0:
                return False
            here[_LOW], here[_HIGH] = left[_LOW] - right[_HIGH], left[_HIGH] - right[_LOW]
            here[_TERMS], here[_HAS_G2] = left[_TERMS], left[_HAS_G2]
        elif operation == 5:
            here[:] = left
        elif operation == 6:
            exponent = constants[slot]
            is_single = left[_TERMS] == 1.0 and left[_HAS_G2] == 0.0
            if not is_single and (exponent < 0.0 or exponent != np.floor(exponent)):
                return False
            ends = exponent * left[_LOW], exponent * left[_HIGH]
            here[_LOW], here[_HIGH] = min(ends[0], ends[1]), max(ends[0], ends[1])
            here[_TERMS], here[_HAS_G2] = left[_TERMS], left[_HAS_G2]
        elif operation == 13 and left[_TERMS] == 1.0 and left[_HAS_G2] == 0.0:
            here[:] = left
        else:
            return False
        if not (here[_LOW] >= -HIGHEST and here[_HIGH] <= HIGHEST):
            return False
    return True
