"""Fair order between keys: start-time fair queueing.

Every job gets a number, its turn, when it is queued, and jobs of equal priority
and lane are taken by turn. The jobs of one key have turns that are at least one
gap apart. A key that comes anew starts right behind the turn that was taken
last: it gains nothing by having been away, and waits for no backlog of others.
So of keys whose jobs wait, each gets one job while another gets one of the same
gap, whatever their numbers.

The gap is what a job costs, in seconds, as far as one can know beforehand. It
is at least one second: small jobs are shared out by number.

P. Goyal, H. M. Vin, H. Cheng: Start-time Fair Queueing, IEEE/ACM Transactions
on Networking 5 (1997) 690-704.
"""

import itertools
from collections.abc import Sequence

LEAST_GAP = 1.0
LARGEST_GAP = 1000.0
"""In seconds; a measured time can be senseless if the clock was set meanwhile."""


def gap_for(seconds: float | None) -> float:
    """Return the gap before a job that is expected to take ``seconds``; None if nobody knows."""
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
    # Never where the queue has passed already: two jobs would then come before one of another key.
    start = taken + LEAST_GAP / 2
    if last is not None and last + gaps[0] > taken:
        start = last + gaps[0]
    return list(itertools.accumulate(gaps[1:], initial=start))
