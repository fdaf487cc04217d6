"""Clients that ask for much and read nothing: the others are served, and the memory comes back.

How long the others wait is measured by ``python -m tests.abuse.readers``.
"""

import http.client
import json
import socket
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from service.storage.database.migration import migrate
from tests.abuse.readers import ATTACKS, MB, memory_of, mute_clients, paths
from tests.support.databases import url_of
from tests.support.serving import Service, serving
from tests.support.sweeps import store_points
from tests.workers.processes import wait_until

CAPACITY = 150
SAMPLES = 100_000


@pytest.fixture(scope="module")
def service(tmp_path_factory) -> Iterator[tuple[Service, dict[str, str]]]:
    folder = tmp_path_factory.mktemp("readers")
    url = url_of(folder / "polhode.db")
    migrate(url)
    sweep_id = store_points(url, 100_000)
    settings = {"POLHODE_DATABASE_URL": url, "POLHODE_MAX_CONNECTIONS": str(CAPACITY)}
    with serving(folder, workers=1, POLHODE_READING_MB="30", **settings) as running:
        yield running, paths(running, sweep_id)


def get(address, path):
    """Return the body, once the service is not busy."""

    def ask():
        try:
            with urllib.request.urlopen(address + path, timeout=120) as answer:
                return answer.read()
        except urllib.error.HTTPError as error:
            with error:
                refusals.append((error.code, json.load(error)["type"], error.headers["Retry-After"]))
        except (ConnectionError, urllib.error.URLError):
            pass  # refused before its request was read
        return None

    refusals: list[tuple[int, str, str]] = []
    content = wait_until(ask)
    for status, kind, after in refusals:
        assert (status, int(after) >= 1) == (503, True)
        assert kind.endswith((":busy", ":too_many_connections"))
    return content


@pytest.mark.parametrize(
    "name",
    [
        "trajectories as CSV",
        "trajectories as JSON, gzip",
        "points as NPZ",
        "sorted points",
        "statistics of points",
        "1000 of a static file",
        "1000 of /openapi.json",
    ],
)
def test_those_who_do_not_read_stop_nobody_and_fill_no_memory(service, name):
    running, named = service
    attack, process = ATTACKS[name], running.process.pid
    before = memory_of(process)
    path, number = attack.path.format(**named), min(attack.clients, CAPACITY - 10)
    with mute_clients(running, path, number, Accept_Encoding=attack.accept_encoding):
        for _ in range(3):
            assert json.loads(get(running.address, "/v1/jobs"))["total"] >= 1
            assert get(running.address, "/livez")
        assert json.loads(get(running.address, "/v1/solutions?limit=1"))["items"]
        # 30 MB that wait, as much while it is made, the buffers of the connections, and what Python keeps.
        assert memory_of(process) - before < 200 * MB
    # It is given back when the clients are gone: all but what is loaded at first use (Arrow, NumPy).
    wait_until(lambda: memory_of(process) - before < 100 * MB)


def test_beside_those_who_do_not_read_a_whole_answer_is_read(service):
    running, named = service
    attack = ATTACKS["trajectories as CSV"]
    path = attack.path.format(**named)
    alone = get(running.address, path)
    assert alone.count(b"\r\n") == SAMPLES + 1
    with mute_clients(running, path, 60):
        assert get(running.address, path) == alone


def test_a_download_is_not_cut_off_by_idle_connections(service):
    running, named = service
    address = ("127.0.0.1", int(running.address.rpartition(":")[2]))
    whole = get(running.address, named["static"])
    with ExitStack() as opened:
        client = opened.enter_context(socket.socket())
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8192)
        client.connect(address)
        client.sendall(f"GET {named['static']} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
        answer = http.client.HTTPResponse(client)
        answer.begin()
        content = answer.read(100_000)
        for _ in range(CAPACITY + 50):
            opened.enter_context(socket.create_connection(address))
            content += answer.read(1000)
        content += answer.read()
    assert content == whole


def test_those_who_do_not_read_make_room_for_new_connections(service):
    running, named = service
    with mute_clients(running, named["static"], CAPACITY):
        assert get(running.address, "/livez")
