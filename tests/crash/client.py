"""Somebody who submits jobs and a sweep, and does not give up until each is acknowledged."""

import json
import threading
import time
from http.client import HTTPException

from tests.crash.installation import Installation

SWEEP_POINTS = 100


class Client(threading.Thread):
    """Submits jobs, a sweep among them, until told that it is enough; every one until it is acknowledged."""

    def __init__(self, installation: Installation, *, jobs: int, seconds: float) -> None:
        super().__init__(daemon=True)
        self._installation = installation
        self.acknowledged: list[str] = []
        self.repeated = 0
        """Requests that got no answer or a 503, and were sent again."""
        # Faster than they are computed: the workers always have something to lose.
        self._jobs, self._pause = jobs, seconds / jobs / 2
        self.fault: BaseException | None = None

    def run(self) -> None:
        try:
            self._submit("/v1/sweeps", sweep())
            for number in range(self._jobs):
                self.acknowledged.append(self._submit("/v1/jobs", problem(number)))
                time.sleep(self._pause)
        except BaseException as fault:
            self.fault = fault

    def _submit(self, path: str, document: object) -> str:
        while True:
            try:
                return self._installation.call("POST", path, document)["id"]
            except (OSError, HTTPException, json.JSONDecodeError):
                self.repeated += 1
                time.sleep(0.1)


def problem(number: int) -> dict:
    """A motion that nobody has computed yet: ten milliseconds of work, every eighth time a hundred."""
    if number % 8:
        return {
            "body": {"A": 2, "B": "3/2", "C": 1},
            # Regular, and therefore computed to the end.
            "potential": {"type": "gravity", "a": f"{1000 + number}/10000000", "c": "-1/2000"},
            "motion": {"type": "state", "omega": ["2/5", "1/10", "9/10"], "gamma": ["3/5", 0, "4/5"]},
            "time": {"stop": 100, "samples": 11},
        }
    return {
        "body": {"A": 2, "B": "3/2", "C": 1},
        "potential": {"type": "gravity", "a": f"-{1000 + number}/1000"},
        "motion": {"type": "planar", "nu": 1},
        "time": {"periods": 1, "samples": 11},
        "outputs": ["gamma", "omega", "invariants", "orientation", "stability"],
    }


def sweep() -> dict:
    return {
        "base": {
            "body": {"A": 2, "C": 1},
            "potential": {"type": "gravity", "a": -1},
            "motion": {"type": "planar", "nu": 1},
            "time": {"periods": 1, "samples": 11},
        },
        "axes": [{"pointer": "/potential/a", "linspace": [-2, -1, SWEEP_POINTS]}],
        "combine": "grid",
        "keep": ["period", "energy"],
        "series": False,
    }
