"""Documents that are read in balls are read alike by many threads at once."""

from concurrent.futures import ThreadPoolExecutor

from flint import ctx

from service.catalogue import classical
from service.schemas.problem.problem import read_problem

EXAMPLES = [row.example for row in classical() if row.example is not None]


def test_many_threads_find_the_same_bodies_and_leave_the_precision_as_it_was():
    before, alone = ctx.prec, [read_problem(example).body for example in EXAMPLES]
    with ThreadPoolExecutor(8) as threads:
        together = list(threads.map(lambda example: read_problem(example).body, EXAMPLES * 6))
    assert together == alone * 6
    assert ctx.prec == before
