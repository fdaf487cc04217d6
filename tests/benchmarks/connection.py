"""A connection that reads what it needs of an answer, and costs next to nothing itself."""

import json
import socket
from collections.abc import Mapping
from urllib.parse import urlsplit

END_OF_CHUNKS = b"\r\n0\r\n\r\n"
"""RFC 9112, 7.1: the last chunk, without trailers."""
_AT_ONCE = 1 << 20


class Connection:
    """One connection to a service, kept open; ``http.client`` takes as long as the service for a 304."""

    def __init__(self, address: str) -> None:
        parts = urlsplit(address)
        assert parts.hostname is not None
        assert parts.port is not None
        self._host = f"{parts.hostname}:{parts.port}"
        self._socket = socket.create_connection((parts.hostname, parts.port))
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def send(
        self, method: str, path: str, document: object, headers: Mapping[str, str]
    ) -> tuple[int, Mapping[str, str]]:
        """Send a request, read its answer to the end; return status and headers, names in small letters."""
        body = b"" if document is None else json.dumps(document).encode()
        sent = {"Host": self._host, **headers}
        if body:
            sent |= {"Content-Type": "application/json", "Content-Length": str(len(body))}
        lines = [f"{method} {path} HTTP/1.1", *(f"{name}: {value}" for name, value in sent.items()), "", ""]
        self._socket.sendall("\r\n".join(lines).encode() + body)
        return self._answer()

    def _answer(self) -> tuple[int, Mapping[str, str]]:
        received = bytearray()
        while (end := received.find(b"\r\n\r\n")) < 0:
            received += self._received()
        first, *lines = received[:end].decode("latin-1").split("\r\n")
        status = int(first.split()[1])
        headers = {name.lower(): value for name, value in (line.split(": ", 1) for line in lines)}
        if headers.get("transfer-encoding") == "chunked":
            while not received.endswith(END_OF_CHUNKS):
                received += self._received()
        else:
            length = 0 if status == 304 else int(headers.get("content-length", 0))
            while len(received) < end + 4 + length:
                received += self._received()
        return status, headers

    def _received(self) -> bytes:
        received = self._socket.recv(_AT_ONCE)
        if not received:
            raise ConnectionError("the service has closed the connection")
        return received
