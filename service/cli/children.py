"""Runs an examination in a child process, so that no formula can block the terminal."""

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console

from service.cli.common import REFUSED, fail
from service.sandbox import Sandbox, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.settings import Settings


@contextmanager
def examining(settings: Settings, module: str) -> Iterator[Sandbox]:
    """Provide a child that has ``module`` loaded; a limit that it exceeds ends the command."""
    sandbox = Sandbox(1, memory_mb=settings.job_memory_mb, preload=[module])
    try:
        with Console(stderr=True).status("examining …"):  # shows nothing where stderr is not a terminal
            yield sandbox
    except SandboxTimeoutError:
        fail(f"no verdict within POLHODE_VERDICT_SECONDS = {settings.verdict_seconds:g}", REFUSED)
    except SandboxMemoryError:
        fail(f"no verdict within POLHODE_JOB_MEMORY_MB = {settings.job_memory_mb}", REFUSED)
    except SandboxCrashError as fault:
        fail(f"no verdict: {fault}", REFUSED)
    finally:
        sandbox.close()
