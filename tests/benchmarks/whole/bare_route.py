"""A FastAPI route without anything around it, on the server of the service.

``python -m tests.benchmarks.whole.bare_route DESCRIPTOR`` serves it on an open listening socket, with the
gate and the limits of connections of the service, until it is ended.
"""

import socket
import sys

import uvicorn
from fastapi import FastAPI

from service.connections.server import guarded
from service.settings import Settings


def main(descriptor: int) -> None:
    """Serve until the end."""
    app = FastAPI()

    @app.get("/")
    async def get_status() -> dict[str, str]:
        """Answer what GET /livez answers."""
        return {"status": "ok"}

    config, listener = guarded(app, Settings(), socket.socket(fileno=descriptor))
    uvicorn.Server(config).run(sockets=[listener])


if __name__ == "__main__":
    main(int(sys.argv[1]))
