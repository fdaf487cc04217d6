"""``polhode serve``, ``worker`` and ``migrate``: run the service and workers, migrate the database."""

from typing import Annotated

import typer

from service.cli.common import DatabaseUrl, become_worker, migrate_database, settings_of
from service.local.worker_command import worker_environment
from service.log_levels import LOG_LEVELS


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
    from service.cli.server import run_service  # noqa: PLC0415

    run_service(settings)


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
