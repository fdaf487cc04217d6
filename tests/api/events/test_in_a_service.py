"""Streams of a real service, in a process of its own: only there signals and sockets take part."""

import signal
import socket
from urllib.parse import urlsplit

from tests.support.api import STATE
from tests.support.serving import serving


def opened(address: str, path: str) -> socket.socket:
    """Return a connection over which a stream has begun."""
    place = urlsplit(address)
    connection = socket.create_connection((place.hostname, place.port), timeout=60)
    connection.sendall(f"GET {path} HTTP/1.1\r\nHost: {place.netloc}\r\n\r\n".encode())
    return connection


def until(connection: socket.socket, words: bytes) -> bytes:
    text = b""
    while words not in text:
        more = connection.recv(65536)
        assert more, text
        text += more
    return text


def rest(connection: socket.socket) -> bytes:
    with connection:
        return b"".join(iter(lambda: connection.recv(65536), b""))


def test_streams_keep_their_connections_and_end_at_sigterm(tmp_path):
    with serving(tmp_path, workers=0, POLHODE_MAX_CONNECTIONS="3") as running:
        job = running.call("POST", "/v1/jobs", STATE).document
        one = opened(running.address, f"/v1/jobs/{job['id']}/events")
        until(one, b'"state": "queued"')
        every = opened(running.address, "/v1/events")
        until(every, b"event: status")
        # Two of three connections are streams: they are not closed to make room, others are.
        idle = [opened(running.address, "/livez") for _ in range(5)]
        assert running.call("POST", f"/v1/jobs/{job['id']}/cancel").status == 200
        until(one, b"event: end\n")
        other = running.call("POST", "/v1/jobs", STATE).document
        waiting = opened(running.address, f"/v1/jobs/{other['id']}/events")
        until(waiting, b"event: job")
        running.process.send_signal(signal.SIGTERM)
        # Both end whole, as an answer in chunks does; only that of the installation with an end of its own.
        assert rest(every).endswith(b'data: {"reason": "stopping"}\n\n\r\n0\r\n\r\n')
        assert rest(waiting).endswith(b"0\r\n\r\n")
        assert running.process.wait(timeout=60) == 0
        for connection in (one, *idle):
            connection.close()
