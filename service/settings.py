"""The settings of a process, read from environment variables POLHODE_…."""

import os
import re
from collections.abc import Mapping
from functools import cache, lru_cache
from ipaddress import ip_address
from typing import Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from service.logs import LogFormat, LogLevel
from service.schemas.reading.numbers import MAX_SAMPLES

_PREFIX = "polhode_"
_POSTGRES = re.compile(
    r"postgresql\+psycopg://(?:[^:/?@]*(?::[^@]*)?@)?(?:\[[^]/?]+\]|[^]/:?[]*)(?::\d{1,5})?(?:/[^?]*)?(?:\?.*)?"
)
_SQLITE = re.compile(r"sqlite:///([^?]+)(?:\?timeout=\d+(?:\.\d+)?)?")
_FILES = "sqlite:///polhode.db is a file of this folder, sqlite:////var/lib/polhode/polhode.db of any"
_ORIGIN = re.compile(r"https?://(?:[a-z0-9.-]+|\[[0-9a-f:.]+\])(?::\d{1,5})?")
"""As browsers write it: in lower case, without a path."""


class Settings(BaseModel):
    """The settings of an installation. Command-line options override them; the defaults suit one machine.

    What is not given is read from the environment, where the names of variables may be in either case.
    """

    model_config = ConfigDict(extra="ignore", validate_default=True)

    database_url: str = "sqlite:///polhode.db"
    engine: Literal["local", "postgres"] = "local"
    """How workers learn of jobs: `local` is for one machine, `postgres` announces jobs to several."""
    pool: Literal["local", "dask"] = "local"
    """Where workers compute: in children of their own, or on a Dask cluster."""
    dask_scheduler: str | None = Field(default=None, min_length=1)
    """Address of the cluster's scheduler, such as tcp://host:8786, or the path of its file."""
    host_name: str | None = Field(default=None, min_length=1, max_length=255)
    """Name of this machine in the database; by default its host name and boot id."""
    host: str = "127.0.0.1"
    """Address to listen on; any but this machine's own needs API keys."""
    port: int = Field(default=8000, ge=0, le=65535)
    """0 lets the system choose a free one."""
    workers: int = Field(default=1, ge=0)
    """Jobs computed at the same time by ``serve``; 0 serves the API only."""
    lease_seconds: float = Field(default=10.0, gt=0)
    """Seconds that a claim holds without a heartbeat; a lost worker's job waits that long."""
    job_seconds: float = Field(default=300.0, gt=0)
    """Time limit of one job."""
    job_memory_mb: int = Field(default=2048, ge=200)
    """Memory one job may take beyond what its idle child process has, in MiB.

    The libraries that a first job may have to load take 110 MiB of it; with less it would never be computed.
    """
    max_attempts: int = Field(default=3, ge=1)
    """A job that has lost so many workers fails."""
    retry_seconds: float = Field(default=1.0, ge=0)
    """Seconds that a job waits after losing a worker; doubled each further time, up to a minute."""
    poll_seconds: float = Field(default=0.5, gt=0)
    """How often an idle worker polls for jobs it was not woken for."""
    grace_seconds: float = Field(default=20.0, ge=0)
    """How long a stopping worker lets its running jobs finish."""
    log_format: LogFormat | None = None
    """None means text on a terminal and JSON elsewhere."""
    log_level: LogLevel | None = None
    """None means warning for the service and info for workers."""
    max_connections: int = Field(default=1000, ge=1)
    """Client connections to ``serve``; fewer if the limit of file descriptors is lower."""
    header_seconds: float = Field(default=10.0, gt=0)
    """How long a client may take to send the head of a request, and to begin its first one."""
    body_seconds: float = Field(default=30.0, gt=0)
    """How long a client may take to send the body of a request."""
    send_seconds: float = Field(default=60.0, gt=0)
    """How long a client may take to read any part of an answer."""
    idle_seconds: int = Field(default=20, ge=1)
    """How long a connection stays open after an answer for the next request."""
    origins: str = ""
    """Other origins, separated by commas, whose pages may send requests that change something."""
    cors_origins: str = ""
    """Origins, separated by commas, whose pages may read answers too (CORS); by default none may."""
    samples_days: float | None = Field(default=None, gt=0)
    """Stored samples older than this are deleted and recomputed on request. None keeps them for ever."""
    verdict_seconds: float = Field(default=10.0, gt=0)
    """Time limit of one verdict on a potential, including the wait for a child process."""
    formula_seconds: float = Field(default=2.0, gt=0)
    """How long the formulas of one verdict may take to simplify; the rest is answered as it stands."""
    verdict_places: int = Field(default=64, ge=1)
    """Requests that may wait for verdicts while all children are busy; one key may use half of the places."""
    requests_per_second: float = Field(default=5000.0, gt=0)
    """For a key without a limit of its own, or for all clients if there are no keys; so the next two."""
    max_queued_jobs: int = Field(default=1_000_000, ge=0)
    """Queued and running jobs; a hundred unfinished points of sweeps count as one."""
    max_stored_mb: int = Field(default=100_000, ge=0)
    """Megabytes (10^6 bytes) of arrays stored for a key; not limited if there are no keys."""
    max_samples: int = Field(default=MAX_SAMPLES, ge=1, le=MAX_SAMPLES)
    """Samples of one problem or one trajectory."""
    max_sweep_points: int = Field(default=10_000_000, ge=1)
    """Points of one sweep."""
    waiting_places: int = Field(default=16, ge=0, le=1000)
    """Clients that may wait for jobs at the same time; each looks its job up four times a second."""
    reading_places: int = Field(default=2, ge=1, le=64)
    """Answers that compute or build much and are made at the same time, each a part at a time."""
    reading_mb: int = Field(default=160, ge=1)
    """Megabytes (10^6 bytes) of such answers that may wait to be sent; one key may use half."""
    event_streams: int = Field(default=500, ge=0)
    """Streams of events at the same time; each is a connection, and none of them takes a thread."""

    @model_validator(mode="before")
    @classmethod
    def _after_the_environment(cls, options: Mapping[str, object]) -> Mapping[str, object]:
        # Not by pydantic-settings, which each process of a service would have to load at its start.
        environment = ((name.lower(), value) for name, value in os.environ.items())
        chosen = {name.removeprefix(_PREFIX): text for name, text in environment if name.startswith(_PREFIX)}
        return {**chosen, **options}

    @field_validator("database_url")
    @classmethod
    def _require_a_database(cls, url: str) -> str:
        """Refuse what fails later, or is another database in each process; repeat no password."""
        scheme, separator, _ = url.partition("://")
        if scheme == "postgresql+psycopg" and not _POSTGRES.fullmatch(url):
            raise ValueError(
                "its host or port cannot be read; accepted is postgresql+psycopg://USER@HOST:PORT/NAME, with "
                "%40 for an @ in a password"
            )
        if scheme == "sqlite":
            _require_a_file(url)
        elif scheme != "postgresql+psycopg":
            is_address = separator and scheme.replace("+", "").isalnum()
            raise ValueError(
                f"{f'{scheme}://' if is_address else 'it'} is no database that is known here; accepted are "
                f"postgresql+psycopg://USER@HOST/NAME, and of SQLite {_FILES}"
            )
        return url

    @field_validator("host")
    @classmethod
    def _without_brackets(cls, host: str) -> str:
        """Return the host; ``[::1]`` is how URLs write ``::1``."""
        return host[1:-1] if host.startswith("[") and host.endswith("]") else host

    @field_validator("engine", mode="before")
    @classmethod
    def _by_its_present_name(cls, engine: object) -> object:
        """Return the engine; `procrastinate` is a former name of `postgres`."""
        return "postgres" if engine == "procrastinate" else engine

    @field_validator("engine")
    @classmethod
    def _require_its_database(cls, engine: str, info: ValidationInfo) -> str:
        # It is not there if it was refused itself.
        if engine == "postgres" and str(info.data.get("database_url", "postgresql")).startswith("sqlite"):
            raise ValueError(
                "the engine postgres needs Postgres, and POLHODE_DATABASE_URL is another database; accepted "
                "are a URL that begins with postgresql+psycopg://, or the engine local"
            )
        return engine

    @field_validator("dask_scheduler")
    @classmethod
    def _require_a_scheduler(cls, scheduler: str | None, info: ValidationInfo) -> str | None:
        if info.data.get("pool") == "dask" and scheduler is None:
            raise ValueError(
                "the pool dask needs its scheduler: POLHODE_DASK_SCHEDULER, an address such as "
                "tcp://host:8786 or the path of a scheduler file; or the pool local"
            )
        return scheduler

    @field_validator("cors_origins")
    @classmethod
    def _require_origins(cls, text: str) -> str:
        for origin in origins_in(text):
            if not _ORIGIN.fullmatch(origin):
                raise ValueError(f"{origin!r} is not an origin; accepted is, for example, https://a.example")
        return text

    @property
    def is_loopback(self) -> bool:
        """Only this machine can reach the service."""
        return is_this_machine(self.host)


def _require_a_file(url: str) -> None:
    name, has_options, options = url.removeprefix("sqlite:///").partition("?")
    is_name = url.startswith("sqlite:///") and name not in ("", ":memory:") and not name.startswith("file:")
    if not is_name:
        raise ValueError(
            f"it names no file, and in memory each process would have another one; accepted: {_FILES}"
        )
    if has_options and not _SQLITE.fullmatch(url):
        raise ValueError(
            f"?{options} is no option of a file of SQLite; accepted is ?timeout=SECONDS, the wait for other "
            "writers, and no file whose name has a question mark"
        )


@cache
def origins_in(text: str) -> frozenset[str]:
    """Return the origins of a list separated by commas."""
    return frozenset(each.strip() for each in text.split(",")) - {""}


class SettingsError(ValueError):
    """Invalid settings; the message is one line that names each of them."""


def read_settings(**options: object) -> Settings:
    """Return the settings of this process; given values that are not None override the environment.

    Raises
    ------
    SettingsError
        One of them is not accepted.
    """
    try:
        chosen = {name: value for name, value in options.items() if value is not None}
        return Settings.model_validate({**Settings().model_dump(), **chosen})
    except ValidationError as fault:
        reasons = (
            f"{'_'.join(map(str, error['loc']))}: {error['msg'].removeprefix('Value error, ')}"
            for error in fault.errors(include_url=False)
        )
        raise SettingsError("; ".join(reasons)) from fault


@lru_cache(maxsize=64)  # asked at each request
def is_this_machine(host: str) -> bool:
    """Tell whether a name or address is a loopback one, which other machines cannot reach."""
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False
