"""Databases of both kinds, made by the migrations, once, and copied for each test."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from alembic import command
from alembic.config import Config

from service.storage.database.database import Database, make_engine
from service.storage.database.migration import migrate, migrations_folder
from service.storage.jobs.job_store import JobStore
from service.storage.solutions.solution_store import SolutionStore
from tests.support.postgres import PostgresServer, postgres_server


def url_of(file: Path) -> str:
    return f"sqlite:///{file}"


FIRST = "0015"
"""The first schema of the migrations."""


def upgrade_to(url: str, revision: str) -> None:
    config = Config()
    config.set_main_option("script_location", str(migrations_folder()))
    config.attributes["engine"] = engine = make_engine(url)
    command.upgrade(config, revision)
    engine.dispose()


def make_template(folder: Path) -> Path:
    template = folder / "template.db"
    migrate(url_of(template))
    return template


def copy_of(template: Path, folder: Path) -> str:
    file = folder / "polhode.db"
    shutil.copy(template, file)
    return url_of(file)


PROBLEM = {"body": {"A": "2", "C": "1"}, "potential": {"type": "expression", "expression": "g1"}}
SUMMARY = {
    "method": "quadrature",
    "tier": "standard",
    "period": {"value": 6.5, "error": 1e-15},
    "energy": {"value": 0.5, "error": 0},
    "error": 3e-15,
}


@pytest.fixture(scope="session")
def sqlite_template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_template(tmp_path_factory.mktemp("template"))


@pytest.fixture(scope="session")
def postgres() -> Iterator[PostgresServer]:
    with postgres_server() as server:
        yield server


@pytest.fixture(scope="session")
def postgres_template(postgres: PostgresServer) -> str:
    template = postgres.create_database()
    migrate(postgres.url(template))
    return template


@pytest.fixture
def sqlite_url(sqlite_template: Path, tmp_path: Path) -> str:
    return copy_of(sqlite_template, tmp_path)


@pytest.fixture
def postgres_url(postgres: PostgresServer, postgres_template: str) -> Iterator[str]:
    with postgres.copy_of(postgres_template) as name:
        yield postgres.url(name)


@pytest.fixture(params=["sqlite", "postgres"])
def url(request: pytest.FixtureRequest) -> str:
    """The URL of a migrated, empty database: every test that uses it runs on both."""
    found = request.getfixturevalue(f"{request.param}_url")
    assert isinstance(found, str)
    return found


@pytest.fixture(params=["sqlite", "postgres"])
def empty_url(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """The URL of a database without tables."""
    yield from empty_database(request.param, request, tmp_path)


def empty_database(kind: str, request: pytest.FixtureRequest, folder: Path) -> Iterator[str]:
    """Yield the URL of a database of this kind without tables, for as long as a test needs it."""
    if kind == "sqlite":
        yield url_of(folder / "empty.db")
        return
    postgres = request.getfixturevalue("postgres")
    name = postgres.create_database()
    yield postgres.url(name)
    postgres.drop_database(name)


@pytest.fixture
def database(url: str) -> Iterator[Database]:
    database = Database(url)
    yield database
    database.close()


@pytest.fixture
def jobs(database: Database) -> JobStore:
    return JobStore(database)


@pytest.fixture
def solutions(database: Database) -> SolutionStore:
    return SolutionStore(database)
