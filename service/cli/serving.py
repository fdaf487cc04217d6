"""``polhode serve``, ``worker`` and ``migrate``: run the service and workers, migrate the database."""

import socket
from typing import Annotated

import typer

from service.cli.common import (
    REFUSED,
    DatabaseUrl,
    become_worker,
    fail,
    migrate_database,
    settings_of,
)
from service.cli.keys import require_key
from service.local.wakeup import Doorbell
from service.local.workers import LocalWorkers, worker_environment
from service.logs import LOG_LEVELS, announce, start_logging
from service.settings import Settings
from service.stopping import StopAsked


def serve(
    host: Annotated[
        str | None, typer.Option(help="Others than loopback need keys. POLHODE_HOST, else 127.0.0.1")
    ] = None,
    port: Annotated[int | None, typer.Option(help="0: any free one. POLHODE_PORT, else 8000")] = None,
    workers: Annotated[
        int | None, typer.Option(help="Jobs at the same time; 0: API only. POLHODE_WORKERS, else 1")
    ] = None,
    database_url: DatabaseUrl = None,
    log_level: Annotated[
        str | None, typer.Option(help=f"{' | '.join(LOG_LEVELS)}. POLHODE_LOG_LEVEL, else warning")
    ] = None,
) -> None:
    """Migrate the database, serve the API and run local workers until SIGTERM or SIGINT."""
    settings = settings_of(
        host=host, port=port, workers=workers, database_url=database_url, log_level=log_level
    )
    start_logging(settings.log_format, settings.log_level or "warning")
    if not settings.is_loopback:
        require_key(settings)
    with _listen(settings.host, settings.port) as listener:
        migrate_database(settings)
        _serve(settings, listener)


def worker(
    slots: Annotated[
        int | None, typer.Option(min=1, help="Jobs at the same time. POLHODE_WORKERS, else 1")
    ] = None,
    database_url: DatabaseUrl = None,
) -> None:
    """Compute queued jobs until SIGTERM or SIGINT."""
    settings = settings_of(workers=slots, database_url=database_url)
    become_worker(["run", "--slots", str(max(settings.workers, 1))], worker_environment(settings))


def migrate(database_url: DatabaseUrl = None) -> None:
    """Create the tables, or upgrade them to this version."""
    migrate_database(settings_of(database_url=database_url))


def _serve(settings: Settings, listener: socket.socket) -> None:
    import uvicorn  # noqa: PLC0415

    from service.app import create_app  # noqa: PLC0415
    from service.connections.server import guarded  # noqa: PLC0415

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
