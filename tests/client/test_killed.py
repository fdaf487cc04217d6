"""A service that is killed and started again in the middle of what somebody asked: no error for them."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import httpx
import numpy as np
import pytest

import polhode as ph
from tests.support.serving import free_port

SERVE = Path(sys.executable).with_name("polhode")


class Killable:
    """``polhode serve`` on one port and one database, killed with its workers and started again at will."""

    def __init__(self, url: str, folder: Path) -> None:
        self.port = free_port()
        self._folder = folder
        # A lease ends soon after its worker has died.
        self._environment = {**os.environ, "POLHODE_DATABASE_URL": url, "POLHODE_LEASE_SECONDS": "2"}
        self.start()

    def start(self) -> None:
        command = [SERVE, "serve", "--port", str(self.port), "--workers", "1"]
        self._process = subprocess.Popen(
            command, cwd=self._folder, env=self._environment, start_new_session=True
        )

    def kill(self) -> None:
        os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()


@pytest.fixture
def killable(url, tmp_path):
    service = Killable(url, tmp_path)
    yield service
    service.kill()


@pytest.mark.long  # a service and its workers start four times
def test_a_service_may_be_killed_and_started_again(killable, tmp_path):
    # Seconds of work: the orbit is integrated for a long time.
    long = ph.problem(
        body=(2, "3/2", 1),
        potential={"type": "gravity", "a": 1, "c": "-1/2"},
        motion={"type": "state", "omega": ["2/5", "1/10", "9/10"], "gamma": ["3/5", 0, "4/5"]},
        stop=20,
    )
    base = ph.problem(body=(2, 1), potential="a*g1 + b/g3^2", a=-1, b="1/20", lam=1, tolerance=1e-9)
    url = f"http://127.0.0.1:{killable.port}"
    with ph.connect(url, cache=tmp_path / "cache", patience=300) as client:
        client.carrier.terms.has_answered = True  # the first start takes as long as the machine likes
        assert client.jobs().count() == 0
        for ask in (
            lambda: client.solve(long).frame(),
            lambda: client.sweep(base, lam=ph.linspace(0.6, 2, 4000), keep=["period"]).frame(),
        ):
            found: list[object] = []
            asking = threading.Thread(target=lambda ask=ask, found=found: found.append(ask()))
            asking.start()
            time.sleep(1.0)  # in the middle of something, whatever it is
            killable.kill()
            time.sleep(0.3)  # nobody listens
            killable.start()
            asking.join(300)
            assert found
            assert len(found[0]) in (101, 4000)
        sweep = next(iter(client.sweeps()))
        assert (len(sweep), client.sweeps().count(), client.jobs("reused=false").count()) == (4000, 1, 1)
        rest: list[object] = []
        asking = threading.Thread(target=lambda: rest.extend(sweep.frame(f"index>={k}") for k in range(200)))
        asking.start()
        killable.kill()
        assert asking.is_alive()
        killable.start()
        asking.join(300)
        assert [len(frame) for frame in rest] == list(range(4000, 3800, -1))


def test_a_stream_of_points_that_ends_too_early_is_asked_for_again(connected, base):
    sweep = connected.sweep(base, lam=ph.linspace(1, 2, 3), keep=["period"])
    whole = sweep.table("index>=0")

    class Half(httpx.BaseTransport):
        def __init__(self, inner: httpx.BaseTransport) -> None:
            self._inner, self.cut = inner, 0

        def handle_request(self, request: httpx.Request) -> httpx.Response:
            response = self._inner.handle_request(request)
            if self.cut < 2 and "/points" in request.url.path:
                self.cut += 1
                content = response.read()
                # The server has died, and a proxy between ends its answer properly.
                return httpx.Response(response.status_code, headers=response.headers, content=content[:-40])
            return response

        def close(self) -> None:
            self._inner.close()

    http = connected.carrier.connections.of().http
    half = http._transport = Half(http._transport)
    assert sweep.table("index>0").equals(whole.slice(1))
    assert half.cut == 2
    assert np.isfinite(whole.column("period").to_numpy()).all()
