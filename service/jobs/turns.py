"""Shares the queue fairly between API keys: start-time fair queueing.

Every job gets a number, its turn, when it is queued; jobs of equal priority and lane
are taken by turn. The turns of one key's jobs are at least one gap apart. A key that
had no jobs starts right behind the turn that was taken last: it gains nothing by the
pause, and does not wait behind the backlog of others. So keys with waiting jobs of
equal gaps get one job each in rotation, however many jobs each has queued.

The gap is the expected cost of a job in seconds. It is at least one second, so that
small jobs are shared by number.

P. Goyal, H. M. Vin, H. Cheng: Start-time Fair Queueing, IEEE/ACM Transactions
on Networking 5 (1997) 690-704.
"""

import itertools
from collections.abc import Sequence

LEAST_GAP = 1.0
LARGEST_GAP = 1000.0
"""Bounds of a gap, in seconds: a measured time can be nonsense if the clock was changed."""


def gap_for(seconds: float | None) -> float:
    """Return the gap before a job that is expected to take ``seconds``; None if unknown."""
    return LEAST_GAP if seconds is None else min(max(seconds, LEAST_GAP), LARGEST_GAP)


def turns(taken: float, last: float | None, gaps: Sequence[float]) -> list[float]:
    """Return the turns of new jobs of one key.

    Parameters
    ----------
    taken
        The largest turn that was taken of the same priority and lane, whosever it was; 0 if none was.
    last
        The largest turn that the key has there; None if it has no job there.
    gaps
        One for each of the jobs, in their order.
    """
    if not gaps:
        return []
    # Never before the turn taken last: two jobs of this key would then precede one of another key.
    start = taken + LEAST_GAP / 2
    if last is not None and last + gaps[0] > taken:
        start = last + gaps[0]
    return list(itertools.accumulate(gaps[1:], initial=start))
