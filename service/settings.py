"""Settings of a process, read from POLHODE_… environment variables when asked for."""

from typing import Literal

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict


class Settings(BaseSettings):
    """What an installation may choose. Command-line options override, defaults serve one machine."""

    model_config = SettingsConfigDict(env_prefix="POLHODE_", extra="ignore")

    database_url: str = "sqlite:///polhode.db"
    engine: Literal["local"] = "local"
    """Who delivers job ids to workers."""
    host: str = "127.0.0.1"
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
    poll_seconds: float = Field(default=0.5, gt=0)
    """How often an idle worker looks for jobs that nobody announced to it."""
    grace_seconds: float = Field(default=20.0, ge=0)
    """How long a worker that was asked to stop lets its running jobs finish."""
    verdict_seconds: float = Field(default=10.0, gt=0)
    """Time limit of one verdict on a potential."""
