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

from service.jobs.keys import Role
from service.storage.database.database import Database
from service.storage.database.migration import migrate
from tests.abuse.readers import ATTACKS, MB, memory_of, mute_clients, paths
from tests.support.databases import url_of
from tests.support.effort import one_in
from tests.support.keys import make
from tests.support.serving import Service, serving
from tests.support.sweeps import store_points
from tests.support.waiting import wait_until

CAPACITY = 150
SAMPLES = 40_000
"""Some 5 MB of text: 60 clients ask for 300 MB, half as much again as they must not fill."""


@pytest.fixture(scope="module")
def service(tmp_path_factory) -> Iterator[tuple[Service, dict[str, str]]]:
    folder = tmp_path_factory.mktemp("readers")
    url = url_of(folder / "polhode.db")
    migrate(url)
    sweep_id = store_points(url, 100_000)
    settings = {"POLHODE_DATABASE_URL": url, "POLHODE_MAX_CONNECTIONS": str(CAPACITY)}
    with serving(folder, workers=1, POLHODE_READING_MB="30", **settings) as running:
        yield running, paths(running, sweep_id, SAMPLES)


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
    # More of the same clients are measured only.
    one_in(4, (name for name in ATTACKS if not name.startswith("many"))),
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


@pytest.mark.long
def test_one_key_that_does_not_read_keeps_no_other_from_large_answers(tmp_path):
    url = url_of(tmp_path / "polhode.db")
    migrate(url)
    sweep_id = store_points(url, 100_000)
    database = Database(url)
    (_, one), (_, other) = (make(database, Role.READ) for _ in range(2))
    database.close()
    settings = {"POLHODE_DATABASE_URL": url, "POLHODE_READING_MB": "30"}
    with serving(tmp_path, workers=0, **settings) as service:
        path = f"/v1/sweeps/{sweep_id}/points?format="

        def ask(kind):
            request = urllib.request.Request(f"{service.address}{path}{kind}", headers=other)
            with urllib.request.urlopen(request, timeout=120) as answer:
                return answer.read()

        alone = {kind: ask(kind) for kind in ("csv", "npz")}
        with mute_clients(service, f"{path}npz", 100, Authorization=one["Authorization"]):
            # Half of the places to wait, and of the bytes, is left: it is not even asked to come again.
            for kind in ("csv", "npz", "csv"):
                assert ask(kind) == alone[kind]
