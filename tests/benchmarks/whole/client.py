"""A client that does as little as possible: one kept connection, requests made beforehand."""

import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from http import HTTPStatus
from types import TracebackType
from typing import Self
from urllib.parse import urlsplit

END_OF_CHUNKS = b"\r\n0\r\n\r\n"
"""RFC 9112, 7.1: the last chunk, without trailers."""


class Line:
    """One connection that is kept alive: ``http.client`` takes as long as the service for a 304."""

    def __init__(self, address: str) -> None:
        place = urlsplit(address)
        self._host = place.netloc
        self._socket = socket.create_connection((place.hostname, place.port), timeout=120.0)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._socket.close()

    def request(self, method: str, path: str, body: bytes = b"", headers: Mapping[str, str] = {}) -> bytes:
        """Return the bytes of a request."""
        given = {"Host": self._host, **headers}
        if body:
            given |= {"Content-Type": "application/json", "Content-Length": str(len(body))}
        lines = [f"{method} {path} HTTP/1.1", *(f"{name}: {value}" for name, value in given.items()), "", ""]
        return "\r\n".join(lines).encode() + body

    def exchange(self, request: bytes) -> tuple[int, bytes]:
        """Send a request; return status and body of its answer."""
        status, _, body = self.answer(request)
        return status, body

    def answer(self, request: bytes) -> tuple[int, Mapping[str, str], bytes]:
        """Send a request; return status, headers (their names in small letters), body with its chunks."""
        self._socket.sendall(request)
        received = b""
        while (end := received.find(b"\r\n\r\n")) < 0:
            received += self._some()
        first, *lines = received[:end].decode("latin-1").split("\r\n")
        headers = {name.lower(): value for name, value in (line.split(": ", 1) for line in lines)}
        status, body = int(first.split(" ", 2)[1]), received[end + 4 :]
        if headers.get("transfer-encoding") == "chunked":
            while not body.endswith(END_OF_CHUNKS):
                body += self._some()
        else:
            length = 0 if status == HTTPStatus.NOT_MODIFIED else int(headers["content-length"])
            while len(body) < length:
                body += self._some()
        return status, headers, body

    def _some(self) -> bytes:
        received = self._socket.recv(1 << 20)
        if not received:
            raise ConnectionError("the service closed the connection")
        return received

    def seconds(self, request: bytes, wanted: int = 200) -> float:
        """Return how long the exchange takes."""
        began = time.perf_counter()
        status, body = self.exchange(request)
        taken = time.perf_counter() - began
        if status != wanted:
            raise RuntimeError(f"{status}: {body[:500]!r}")
        return taken


@contextmanager
def bare_route() -> Iterator[str]:
    """Run the bare route in a process of its own; yield its address."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        process = subprocess.Popen(
            [sys.executable, "-m", "tests.benchmarks.whole.bare_route", str(listener.fileno())],
            pass_fds=[listener.fileno()],
        )
    try:
        yield f"http://127.0.0.1:{port}/"
    finally:
        process.terminate()
        process.wait(30.0)
