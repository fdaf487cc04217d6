"""The number of jobs that one call of a child computes: as many as take a moment, judged by earlier calls."""

BATCH_SECONDS = 0.05
"""A call begins no further job after so long; nobody waits longer for a place because of a batch."""
MOST_TOGETHER = 32
_GROWTH = 4


class BatchSize:
    """The number of jobs that one worker gives to a child at a time.

    It begins with one, grows only while jobs are known to be short, and falls at once when they are not.
    """

    def __init__(self) -> None:
        self.most = 1

    def learn(self, number: int, seconds: float) -> None:
        """Record that ``number`` jobs have taken a child ``seconds`` in all.

        A smaller batch that was done in time tells nothing: most of its time may be that of the call.
        """
        if number < self.most and seconds <= BATCH_SECONDS:
            return
        fitting = int(BATCH_SECONDS * number / seconds) if seconds > 0.0 else MOST_TOGETHER
        self.most = max(1, min(fitting, _GROWTH * self.most, MOST_TOGETHER))

    def reset(self) -> None:
        """Record that a batch was not computed as one."""
        self.most = 1
