"""What ``make test`` does of a law, and what it leaves to ``make test-long``.

Every law is tested by both; ``make test-long`` tests it in more cases, which
take long and seldom find what the others do not.

- ``examples``: random laws draw few examples or many. Such tests carry the
  marker ``random_law``, by which ``make test-long`` chooses them.
  ``make test-long EXAMPLES=some`` draws as many as lie halfway between the
  two in ratio: so a clean clone is tested, in a time one can wait for.
- ``seldom``: cases beside others of the same table.
- ``one_in``: of a table whose cases are alike, ``make test`` takes one in so many. So does the marker
  ``one_in`` of a whole test.
- ``each_once``: of the combinations of several tables, ``make test`` takes so
  many that it meets every value of every table.
"""

import itertools
import math
import os
from collections.abc import Iterable, Sequence

import pytest

EFFORT = os.environ.get("POLHODE_TEST_EXAMPLES", "few")
"""``few``, ``some`` or ``many``: how much is asked of the tests."""


def examples(few: int, many: int) -> int:
    """Return how many to draw."""
    return {"few": few, "some": round(math.sqrt(few * many)), "many": many}[EFFORT]


def seldom(*cases: object) -> list:
    """Return cases of a table, each a value or a tuple of values, that ``make test-long`` tests only."""
    rows = [case if isinstance(case, _CASE) else pytest.param(*_values(case)) for case in cases]
    return [pytest.param(*row.values, marks=[*row.marks, pytest.mark.long], id=row.id) for row in rows]


_CASE = type(pytest.param())


def _values(case: object) -> tuple[object, ...]:
    return case if isinstance(case, tuple) else (case,)


def one_in(count: int, cases: Iterable[object]) -> list:
    """Return cases of a table, of which ``make test`` tests one in ``count``, beginning with the first."""
    return [case for k, each in enumerate(cases) for case in ([each] if k % count == 0 else seldom(each))]


def each_once(**tables: Sequence[object]) -> pytest.MarkDecorator:
    """Parametrize by all combinations; ``make test`` takes a diagonal, in which each value occurs.

    A name ``one__two`` stands for two parameters, whose values are pairs; so does one of more parts.
    """
    lengths = [len(values) for values in tables.values()]
    diagonal = {tuple(k % length for length in lengths) for k in range(max(lengths))}
    cases = []
    for places in itertools.product(*map(range, lengths)):
        case: list[object] = []
        for (name, values), place in zip(tables.items(), places, strict=True):
            case.extend(values[place] if "__" in name else [values[place]])
        cases.append(pytest.param(*case, marks=() if places in diagonal else pytest.mark.long))
    return pytest.mark.parametrize([part for name in tables for part in name.split("__")], cases)
