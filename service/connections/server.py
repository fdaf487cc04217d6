"""Sets up uvicorn with the gate, the deadlines and the listening socket of this package."""

import logging
import socket

import uvicorn
from fastapi import FastAPI

from service.connections.gate import Gate
from service.connections.listener import Listener, connections_for
from service.connections.protocol import Deadlines, watched
from service.logs import Complaints
from service.settings import Settings

logger = logging.getLogger(__name__)

FINISH_REQUESTS_SECONDS = 3
"""How long open requests may go on after a signal to stop."""
_ACCEPTED_AT_ONCE = 8
"""Connections accepted in one turn of the event loop; they are counted only after it."""
_TOLD_ALREADY = (
    "socket.accept() out of system resource",
    "Invalid HTTP request received.",
    "Unsupported upgrade request.",
)


def guarded(app: FastAPI, settings: Settings, opened: socket.socket) -> tuple[uvicorn.Config, Listener]:
    """Return what a server of ``app`` needs: its configuration, and the socket that ``opened`` becomes."""
    gate = Gate(connections_for(settings.max_connections), Complaints(logger))
    app.state.close_one_unread = gate.close_one_unread
    deadlines = Deadlines(
        head=settings.header_seconds, body=settings.body_seconds, send=settings.send_seconds
    )
    # The gate logs faults of clients at a limited rate; otherwise clients could fill the log.
    for name in ("asyncio", "uvicorn.error"):
        logging.getLogger(name).addFilter(_is_not_told_already)
    config = uvicorn.Config(
        app,
        http=watched(gate, deadlines),
        ws="none",
        loop="asyncio",
        access_log=False,
        log_config=None,
        server_header=False,
        backlog=_ACCEPTED_AT_ONCE,
        timeout_keep_alive=settings.idle_seconds,
        timeout_graceful_shutdown=FINISH_REQUESTS_SECONDS,
    )
    return config, Listener(gate, fileno=opened.detach())


def _is_not_told_already(record: logging.LogRecord) -> bool:
    return not str(record.msg).startswith(_TOLD_ALREADY)
