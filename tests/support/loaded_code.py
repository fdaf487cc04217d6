"""Counts the compiled functions that a process has loaded, from the cache or by compiling them."""

import gc
import json
from pathlib import Path


def loaded() -> int:
    from numba.core.dispatcher import Dispatcher  # noqa: PLC0415

    gc.unfreeze()  # else what was there before the fork is not among all objects
    kernels = [each for each in gc.get_objects() if isinstance(each, Dispatcher)]
    return sum(
        sum(each.stats.cache_hits.values()) + sum(each.stats.cache_misses.values()) for each in kernels
    )


def loaded_by(documents: str) -> str:
    """Return how many are loaded, and how many more after the problems are solved; called in a child."""
    from service.jobs.records import Refused  # noqa: PLC0415
    from workers.computation.compute import solve_document  # noqa: PLC0415

    before = loaded()
    for document in json.loads(documents):
        outcome = solve_document(json.dumps(document))
        assert not isinstance(outcome, Refused), outcome
    return json.dumps([before, loaded() - before])


def threads() -> int:
    """Return how many threads this process has, those of libraries too."""
    return len(list(Path("/proc/self/task").iterdir()))
