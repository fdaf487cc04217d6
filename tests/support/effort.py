"""How many examples the dearest random laws draw: few in ``make test``, many in ``make test-long``.

A law is the same with either; many find what is rare. Such tests carry the
marker ``random_law``, by which ``make test-long`` chooses them.
"""

import os

DRAWS_MANY = os.environ.get("POLHODE_TEST_EXAMPLES") == "many"


def examples(few: int, many: int) -> int:
    """Return how many to draw."""
    return many if DRAWS_MANY else few
