"""The main job, end to end, over HTTP: verdicts, two solutions, pictures; then a clean stop."""

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

from picture import draw

HERE = Path(__file__).parent
OUTPUT = HERE.parent / "demo-output"
SAMPLES_SHOWN = 5
READY_SECONDS = 300


def main() -> int:
    """Run the demonstration; 0 if everything went as it should."""
    shutil.rmtree(OUTPUT, ignore_errors=True)
    OUTPUT.mkdir()
    address = f"http://127.0.0.1:{free_port()}"
    service = start_service(address)
    try:
        wait_until_ready(address, service)
        say(f"The service answers at {address}, its database is {OUTPUT / 'polhode.db'}.")
        refuse_the_printed_potential(address)
        for name in ("bobylev-steklov", "cubic-body"):
            solve(address, name)
        tell_the_background(address)
    finally:
        service.send_signal(signal.SIGTERM)
        code = service.wait(timeout=30)
    say(f"The service has stopped (exit code {code}).")
    return code


def refuse_the_printed_potential(address: str) -> None:
    """Ask for the verdict on a term as it was once printed."""
    document = read("printed-a3")
    verdict = call(address, "POST", "/v1/validations", document)
    say(f"\nV = {document['potential']['expression']}")
    say(f"is {verdict['verdict']}: at (g1, g2, g3) = ({', '.join(verdict['counterexample']['g'])})")
    residual = verdict["counterexample"]["residual"]
    say(f"the compatibility equation leaves {residual['mid']} ± {residual['rad']}.")
    if verdict["verdict"] != "inadmissible":
        raise SystemExit("this potential is known to be inadmissible")


def solve(address: str, name: str) -> None:
    """Submit a problem, wait for its solution, print and draw it."""
    document = read(name)
    say(f"\n{name}: body {document['body']}, potential {document['potential']}, motion {document['motion']}")
    job = call(address, "POST", "/v1/jobs", document, {"Prefer": "wait=30"})
    while job["state"] in ("queued", "running"):
        time.sleep(0.2)
        job = call(address, "GET", f"/v1/jobs/{job['id']}")
    if job["state"] != "succeeded":
        raise SystemExit(f"the job has {job['state']}: {job['error']}")
    solution = call(address, "GET", f"/v1/solutions/{job['solution']}")
    columns = call(address, "GET", f"/v1/solutions/{job['solution']}/trajectory")["columns"]
    say(f"  period     {solution['period']['value']!r} ± {solution['period']['error']:.1e}")
    say(f"  energy     {solution['energy']['value']!r} ± {solution['energy']['error']:.1e}")
    say(f"  error      ≤ {solution['error']:.1e} in every variable")
    ways = {"plain": "without kernels, which are not compiled yet", "compiled": "by compiled kernels"}
    say(f"  found      {ways[solution['provenance']['way']]}")
    drifts = (f"{integral} {value['drift']:.1e}" for integral, value in solution["invariants"].items())
    say(f"  drift of   {', '.join(drifts)}")
    say("  " + "".join(f"{column:>13}" for column in columns))
    last = len(columns["t"]) - 1
    for row in (round(k * last / (SAMPLES_SHOWN - 1)) for k in range(SAMPLES_SHOWN)):
        say("  " + "".join(f"{values[row]:z13.8f}" for values in columns.values()))
    picture = OUTPUT / f"{name}.svg"
    draw(columns, name, picture)
    say(f"  picture    {picture}")


def tell_the_background(address: str) -> None:
    """Say what the workers do meanwhile."""
    kernels = call(address, "GET", "/readyz").get("compiling")
    if kernels is None:
        say("\nThe kernels are compiled: solutions come from them.")
    else:
        say(
            f"\nIn the background the kernels are compiled, which make jobs and sweeps faster "
            f"({kernels['done']} of {kernels['of']})."
        )
        say("That goes on where it stops when a service runs, or at once by: .venv/bin/polhode compile")


def start_service(address: str) -> "subprocess.Popen[bytes]":
    """Start the service on a fresh SQLite file."""
    port = address.rpartition(":")[2]
    polhode = Path(sys.executable).with_name("polhode")
    environment = {**os.environ, "POLHODE_LOG_FORMAT": "text"}
    return subprocess.Popen([polhode, "serve", "--port", port], cwd=OUTPUT, env=environment)


def wait_until_ready(address: str, service: "subprocess.Popen[bytes]") -> None:
    """Return when the service is ready for work."""
    deadline = time.monotonic() + READY_SECONDS
    while time.monotonic() < deadline:
        if service.poll() is not None:
            raise SystemExit(f"the service has stopped with exit code {service.returncode}")
        try:
            call(address, "GET", "/readyz")
        except OSError:
            time.sleep(0.05)
        else:
            return
    raise SystemExit(f"the service is not ready after {READY_SECONDS} seconds")


def call(
    address: str, method: str, path: str, document: object = None, headers: dict[str, str] | None = None
) -> dict[str, Any]:
    """Send a request and return the JSON of the answer."""
    body = None if document is None else json.dumps(document).encode()
    sent = {"Content-Type": "application/json", **(headers or {})}
    request = urllib.request.Request(address + path, data=body, headers=sent, method=method)
    with urllib.request.urlopen(request, timeout=60) as answer:
        found: dict[str, Any] = json.load(answer)
    return found


def read(name: str) -> dict[str, Any]:
    """Return an example problem."""
    found: dict[str, Any] = json.loads((HERE / f"{name}.json").read_text(encoding="utf-8"))
    return found


def free_port() -> int:
    """Return a port nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
