"""Bring a database to the schema of this version."""

from pathlib import Path

from alembic import command
from alembic.config import Config

from service.storage.database import make_engine
from service.storage.jobs import procrastinate_schema


def migrations_folder() -> Path:
    """Return the folder of the migrations: inside the package if installed, at the top of a checkout else."""
    packaged = Path(__file__).with_name("_migrations")
    return packaged if packaged.is_dir() else Path(__file__).parents[2] / "migrations"


def migrate(url: str, *, engine_name: str = "local") -> None:
    """Create or upgrade the tables; harmless if nothing is left to do, or if several do it at once.

    ``engine_name`` is that of the settings: some engines have tables of their own.
    """
    config = Config()
    # Alembic's options interpolate %, which a folder's name may contain.
    config.set_main_option("script_location", str(migrations_folder()).replace("%", "%%"))
    engine = make_engine(url)
    config.attributes["engine"] = engine
    try:
        command.upgrade(config, "head")
        if engine_name == "procrastinate":
            procrastinate_schema.install(engine)
    finally:
        engine.dispose()
