"""Runs the service for ``polhode serve``: the database, the API and the worker process beside it."""

import socket

import typer
import uvicorn

from service.app import create_app
from service.cli.common import REFUSED, fail, migrate_database
from service.cli.keys import require_key
from service.connections.server import guarded
from service.local.wakeup import Doorbell
from service.local.workers import LocalWorkers
from service.logs import announce, start_logging
from service.settings import Settings
from service.stopping import StopAsked


def run_service(settings: Settings) -> None:
    """Serve until SIGTERM or SIGINT."""
    start_logging(settings.log_format, settings.log_level or "warning")
    if not settings.is_loopback:
        require_key(settings)
    with _listen(settings.host, settings.port) as listener:
        migrate_database(settings)
        _serve(settings, listener)


def _serve(settings: Settings, listener: socket.socket) -> None:
    class _Server(uvicorn.Server):
        async def startup(self, sockets: list[socket.socket] | None = None) -> None:
            # Uvicorn handles signals by now; this flag holds those that came before.
            self.should_exit |= stop.is_asked
            await super().startup(sockets)

        async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
            if workers is not None:
                workers.expect_end()
            # Workers finish and stop; clients that wait for a job get its present state.
            doorbell.close()
            await super().shutdown(sockets)

    # From here on the end needs a clean-up.
    with StopAsked() as stop:
        doorbell = Doorbell()
        workers = LocalWorkers(settings, doorbell) if settings.workers else None
        try:
            standing = None if workers is None else workers.standing
            app = create_app(settings, doorbell=doorbell, local_worker=standing)
            config, listener = guarded(app, settings, listener)
            server = _Server(config)
            host, port = listener.getsockname()[:2]
            announce(
                f"serving http://{f'[{host}]' if ':' in host else host}:{port}, {settings.workers} workers"
            )
            # Uvicorn raises the signals it received again at its end: they have been handled already.
            server.run(sockets=[listener])
            if not server.started:
                raise typer.Exit(REFUSED)
        finally:
            if workers is not None:
                workers.stop()
            doorbell.close()


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family)
    except OSError as fault:
        fail(f"cannot listen on {host} port {port}: {fault.strerror or fault}", REFUSED)
