"""Settings of a process, read from POLHODE_… environment variables when asked for."""

from ipaddress import ip_address
from typing import Literal

from pydantic import Field, ValidationError, ValidationInfo, field_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from service.logs import LogFormat, LogLevel
from service.schemas.numbers import MAX_SAMPLES


class Settings(BaseSettings):
    """What an installation may choose. Command-line options override, defaults serve one machine."""

    model_config = SettingsConfigDict(env_prefix="POLHODE_", extra="ignore")

    database_url: str = "sqlite:///polhode.db"
    engine: Literal["local", "procrastinate"] = "local"
    """Who delivers jobs to workers: nobody, for those of one machine; or Procrastinate, by Postgres."""
    host_name: str | None = Field(default=None, min_length=1, max_length=255)
    """What this machine is called among others. If not chosen, its name and its boot."""
    host: str = "127.0.0.1"
    """Others than this machine's own need keys."""
    port: int = Field(default=8000, ge=0, le=65535)
    """0 lets the system choose a free one."""
    workers: int = Field(default=1, ge=0)
    """Jobs computed at the same time by ``serve``; 0 serves the API only."""
    lease_seconds: float = Field(default=10.0, gt=0)
    """How long a claim lives without a heartbeat; a lost worker's job waits that long."""
    job_seconds: float = Field(default=300.0, gt=0)
    """Time limit of one job."""
    job_memory_mb: int = Field(default=2048, gt=0)
    """Memory one job may take beyond what its idle child process has, in MiB."""
    max_attempts: int = Field(default=3, ge=1)
    """How many workers one job may lose before it is given up."""
    retry_seconds: float = Field(default=1.0, ge=0)
    """How long a job waits that has lost a worker; twice as long each further time, up to a minute."""
    poll_seconds: float = Field(default=0.5, gt=0)
    """How often an idle worker looks for jobs that nobody announced to it."""
    grace_seconds: float = Field(default=20.0, ge=0)
    """How long a worker that was asked to stop lets its running jobs finish."""
    log_format: LogFormat | None = None
    """If not chosen, text on a terminal and JSON elsewhere."""
    log_level: LogLevel | None = None
    """If not chosen, warning for the service and info for workers."""
    max_connections: int = Field(default=1000, ge=1)
    """Connections of clients to ``serve``; fewer where there are not so many file descriptors."""
    header_seconds: float = Field(default=10.0, gt=0)
    """How long a client may take for the head of a request, and before its first one."""
    body_seconds: float = Field(default=30.0, gt=0)
    """How long a client may take for the body of a request."""
    send_seconds: float = Field(default=60.0, gt=0)
    """How long a client may leave an answer unread, or any next part of it."""
    idle_seconds: int = Field(default=20, ge=1)
    """How long a connection is kept after an answer for a next request."""
    origins: str = ""
    """Origins of pages, separated by commas, that may send what changes something, beside the own one."""
    samples_days: float | None = Field(default=None, gt=0)
    """Stored samples that are older are deleted; they can be made again. None keeps them for ever."""
    verdict_seconds: float = Field(default=10.0, gt=0)
    """Time limit of one verdict on a potential, with the time for which it waits for a child process."""
    verdict_places: int = Field(default=64, ge=1)
    """Verdicts that may be waited for while all children are at work; a key may have half of the places."""
    requests_per_second: float = Field(default=5000.0, gt=0)
    """Of a key without a limit of its own, or of everybody where there are no keys; so the next two."""
    max_queued_jobs: int = Field(default=1_000_000, ge=0)
    """Jobs that are queued or running; a hundred points that sweeps have left count as one."""
    max_stored_mb: int = Field(default=100_000, ge=0)
    """Megabytes (10^6 bytes) of arrays that were stored for a key; nobody counts where there are no keys."""
    max_samples: int = Field(default=MAX_SAMPLES, ge=1, le=MAX_SAMPLES)
    """Samples of one problem or one trajectory."""
    max_sweep_points: int = Field(default=10_000_000, ge=1)
    """Points of one sweep."""
    waiting_places: int = Field(default=16, ge=0, le=1000)
    """Clients that may wait for jobs at the same time; each has its job looked up four times a second."""

    @field_validator("engine")
    @classmethod
    def _require_its_database(cls, engine: str, info: ValidationInfo) -> str:
        url = str(info.data.get("database_url", ""))
        if engine == "procrastinate" and not url.startswith("postgresql"):
            raise ValueError("procrastinate delivers by Postgres, and POLHODE_DATABASE_URL is none")
        return engine

    @property
    def is_loopback(self) -> bool:
        """Only this machine can reach the service."""
        return is_this_machine(self.host)


class SettingsError(ValueError):
    """Settings that cannot be; the message is one line that names each of them."""


def read_settings(**given: object) -> Settings:
    """Return the settings of this process; what is given, and not None, comes first.

    Raises
    ------
    SettingsError
        One of them is not accepted.
    """
    try:
        chosen = {name: value for name, value in given.items() if value is not None}
        return Settings.model_validate({**Settings().model_dump(), **chosen})
    except ValidationError as fault:
        reasons = (
            f"{'_'.join(map(str, error['loc']))}: {error['msg']}" for error in fault.errors(include_url=False)
        )
        raise SettingsError("; ".join(reasons)) from fault


def is_this_machine(host: str) -> bool:
    """Say whether a name or address is one by which only this machine calls itself."""
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False
