from fractions import Fraction

import numpy as np
from flint import arb, ctx
from hypothesis import assume, given, settings

from tests.support.admissible import Case, cases, with_periodic_window
from tests.support.effort import examples
from workers.solvers.choose import enclose
from workers.solvers.errors import CertifiedUnavailableError


@given(cases())
@settings(max_examples=examples(4, 12), deadline=None)
def test_the_quadrature_keeps_its_claims(case: Case):
    periodic = with_periodic_window(case)
    assume(periodic is not None)
    problem = periodic.problem()
    times = [Fraction(k) for k in range(8)]
    try:
        found = enclose(problem.body, problem.potential, problem.motion, times, 64)
    except CertifiedUnavailableError:
        # A pole passed without smoothness, or a formula with 0 · |g3|^-n there.
        assume(False)
        raise
    motion = periodic.solve()
    values = motion.dense(np.arange(8.0))
    with ctx.workprec(300):
        period = motion.dense.period
        assert abs(found.period - arb(period.hi) - arb(period.lo)).lower() <= period.error
        assert abs(found.energy - arb(motion.energy.value)).lower() <= motion.energy.error
        for row, state in zip(values, found.states, strict=True):
            for value, ball in zip(row, state, strict=True):
                assert abs(ball - arb(float(value))).lower() <= motion.error
