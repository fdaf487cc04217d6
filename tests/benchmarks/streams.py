"""Streams of events beside a working sweep: what they take of memory, and what other requests notice.

``python -m tests.benchmarks.streams [streams]``
"""

import asyncio
import http.client
import sys
import tempfile
import time
from pathlib import Path
from urllib.parse import urlsplit

from tests.benchmarks.measuring import say
from tests.support.serving import Service, serving

STREAMS, REQUESTS = 500, 300
POINTS = 1_000_000
SWEEP = {
    "base": {
        "body": {"A": 2, "C": 1},
        "potential": {
            "type": "expression",
            "expression": "a*g1 + b/g3^2",
            "parameters": {"a": -1, "b": "1/20"},
        },
        "motion": {"type": "planar", "lambda": 1},
        "time": {"periods": 1, "samples": 20},
    },
    "axes": [{"pointer": "/motion/lambda", "linspace": [0.6, 2, POINTS]}],
    "keep": ["period", "energy", "error"],
}


def main() -> None:
    """Print memory, threads and latencies without streams and with them."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else STREAMS
    settings = {"POLHODE_EVENT_STREAMS": str(count)}
    with tempfile.TemporaryDirectory() as folder, serving(Path(folder), **settings) as running:
        sweep = running.call("POST", "/v1/sweeps", SWEEP).document
        while running.call("GET", f"/v1/sweeps/{sweep['id']}").document["done"] == 0:
            time.sleep(0.2)
        job = running.call("POST", "/v1/jobs?priority=-1", SWEEP["base"]).document
        alone = _measured(running, job["id"])
        beside = asyncio.run(_with_streams(running, sweep["id"], job["id"], count))
    say(f"{'':28}{'alone':>12}{f'{count} streams':>14}")
    for name, one in alone.items():
        say(f"{name:28}{one:>12.6g}{beside.pop(name):>14.6g}")
    for name, value in beside.items():
        say(f"{name:40}{value:>14.6g}")


def _measured(running: Service, job_id: str) -> dict[str, float]:
    """Return memory and threads of the API process, and the latencies of GET."""
    connection = http.client.HTTPConnection(urlsplit(running.address).netloc)
    times = []
    for _ in range(REQUESTS):
        began = time.perf_counter()
        connection.request("GET", f"/v1/jobs/{job_id}")
        connection.getresponse().read()
        times.append(1e3 * (time.perf_counter() - began))
    connection.close()
    times.sort()
    status = Path(f"/proc/{running.process.pid}/status").read_text(encoding="ascii")
    told = dict(line.split(":", 1) for line in status.splitlines())
    return {
        "memory of the API, MB": int(told["VmRSS"].split()[0]) / 1e3,
        "threads of the API": int(told["Threads"]),
        "GET of a job, median, ms": times[len(times) // 2],
        "GET of a job, p99, ms": times[len(times) * 99 // 100],
    }


async def _with_streams(running: Service, sweep_id: str, job_id: str, count: int) -> dict[str, float]:
    """Open streams, half of the sweep and half of the installation; measure while they are told of it."""
    place, told = urlsplit(running.address), 0

    async def read(path: str) -> None:
        nonlocal told
        reader, writer = await asyncio.open_connection(place.hostname, place.port, limit=1 << 20)
        writer.write(f"GET {path} HTTP/1.1\r\nHost: {place.netloc}\r\n\r\n".encode())
        async for line in reader:
            told += line.startswith(b"data: ")

    paths = [f"/v1/sweeps/{sweep_id}/events", "/v1/events"]
    reading = [asyncio.create_task(read(paths[k % 2])) for k in range(count)]
    while told < count:
        await asyncio.sleep(0.1)
    before, began = told, time.perf_counter()
    found = await asyncio.to_thread(_measured, running, job_id)
    await asyncio.sleep(5.0)
    seconds = time.perf_counter() - began
    found["events to all streams in a second"] = (told - before) / seconds
    for task in reading:
        task.cancel()
    await asyncio.gather(*reading, return_exceptions=True)
    return found


if __name__ == "__main__":
    main()
