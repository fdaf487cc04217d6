"""What asking again and sending again cost: 304 beside the full answer, and the price of an Idempotency-Key.

``python -m tests.benchmarks.answers [--requests N]``: by one connection to a service on SQLite, with the
compared requests in turns, so that both see the same machine. The client takes next to no time itself:
what it took would be added to both sides.
"""

import argparse
import json
import statistics
import tempfile
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from tests.benchmarks.measuring import say
from tests.benchmarks.whole.client import Line
from tests.benchmarks.whole.requests import wait_until_warm
from tests.support.serving import serving

REQUESTS = 300
BODY, LAMBDA = {"A": 2, "C": 1}, 1
PROBLEM = {
    "body": BODY,
    "potential": {"type": "expression", "expression": "a*g1 + b/g3^2", "parameters": {"a": -1, "b": "1/20"}},
    "motion": {"type": "planar", "lambda": LAMBDA},
    "time": {"stop": 10, "samples": 1001},
}
SWEEP = {
    "base": {**PROBLEM, "time": {"periods": 1, "samples": 20}},
    "axes": [{"pointer": "/motion/lambda", "linspace": [0.6, 2, 1000]}],
    "keep": ["period", "energy", "error"],
}
ASKED = 5.0
"""How many times as fast as the full answer 304 ought to be."""
ALLOWED_MS = 1.0
"""What a key may cost."""

Send = Callable[[str, str, object, Mapping[str, str]], tuple[int, Mapping[str, str]]]


def main() -> None:
    """Print both tables."""
    options = argparse.ArgumentParser(prog="python -m tests.benchmarks.answers")
    options.add_argument("--requests", type=int, default=REQUESTS, help="of each kind")
    count = options.parse_args().requests
    with tempfile.TemporaryDirectory() as folder, serving(Path(folder)) as service:
        sweep = service.call("POST", "/v1/sweeps", SWEEP).document
        job = service.call("POST", "/v1/jobs", PROBLEM, Prefer="wait=60").document
        while service.call("GET", f"/v1/sweeps/{sweep['id']}").document["finished_at"] is None:
            time.sleep(0.1)
        # What still loads would be measured, too.
        wait_until_warm(service)
        with Line(service.address) as line:

            def send(
                method: str, path: str, document: object, headers: Mapping[str, str]
            ) -> tuple[int, Mapping[str, str]]:
                body = b"" if document is None else json.dumps(document).encode()
                status, told, _ = line.answer(line.request(method, path, body, headers))
                return status, told

            solution = f"/v1/solutions/{job['solution']}"
            _asked_again(
                send,
                {
                    "trajectory, 1001 samples": f"{solution}/trajectory",
                    "trajectory, 1001 samples, Arrow": f"{solution}/trajectory?format=arrow",
                    "trajectory at 10 000 other times": f"{solution}/trajectory?start=0&stop=9&samples=10000",
                    "function of time": f"{solution}/function",
                    "points of a sweep, 1000 as CSV": f"/v1/sweeps/{sweep['id']}/points?format=csv",
                    "summary of a solution": solution,
                },
                count,
            )
            _sent_again(send, count)


def _asked_again(send: Send, paths: Mapping[str, str], count: int) -> None:
    title = f"median of {count}, ms"
    say(f"{title:36}{'200':>9}{'304':>9}{'ratio':>8}   asked: {ASKED:g}{'/livez':>10}")
    for name, path in paths.items():
        status, headers = send("GET", path, None, {})
        assert status == 200
        known = {"If-None-Match": headers["etag"]}
        full, again, least = _in_turns(
            count,
            lambda path=path: send("GET", path, None, {})[0] == 200,
            lambda path=path, known=known: send("GET", path, None, known)[0] == 304,
            lambda: send("GET", "/livez", None, {})[0] == 200,
        )
        say(f"{name:36}{_ms(full):>9.2f}{_ms(again):>9.2f}{_ms(full) / _ms(again):>8.1f}{_ms(least):>21.2f}")


def _sent_again(send: Send, count: int) -> None:
    """Measure a job whose problem is solved already: the least that a POST can take."""
    kept = {"Idempotency-Key": str(uuid.uuid4())}
    send("POST", "/v1/jobs", PROBLEM, kept)
    without, with_key, replayed = _in_turns(
        count,
        lambda: send("POST", "/v1/jobs", PROBLEM, {})[0] == 202,
        lambda: send("POST", "/v1/jobs", PROBLEM, {"Idempotency-Key": str(uuid.uuid4())})[0] == 202,
        lambda: send("POST", "/v1/jobs", PROBLEM, kept)[1]["idempotency-replayed"] == "true",
    )
    say(f"\n{'POST of a job, ms':36}{'median':>9}{'p95':>9}")
    for name, times in (
        ("without a key", without),
        ("with a new key", with_key),
        ("with a key that was sent", replayed),
    ):
        say(f"{name:36}{_ms(times):>9.2f}{1e3 * statistics.quantiles(times, n=20)[-1]:>9.2f}")
    say(f"{'a key costs':36}{_ms(with_key) - _ms(without):>9.2f}            asked: {ALLOWED_MS:g}")


def _in_turns(count: int, *ways: Callable[[], bool]) -> list[list[float]]:
    """Return the seconds of each way; each says whether it was answered as expected."""
    times: list[list[float]] = [[] for _ in ways]
    for _ in range(count):
        for way, found in zip(ways, times, strict=True):
            began = time.perf_counter()
            is_right = way()
            found.append(time.perf_counter() - began)
            assert is_right
    return times


def _ms(times: Sequence[float]) -> float:
    return 1e3 * statistics.median(times)


if __name__ == "__main__":
    main()
