"""Run services of ``docker/compose.yaml`` from their images as Compose would, in chroots."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.container.images import output
from tests.container.test_compose import COMPOSE, EXAMPLE, interpolated, seconds

RUN = ("buildah", "run", "--isolation=chroot")
PATIENCE_SECONDS = 180.0
"""Until something that has not come is given up; far more than anything takes on a busy machine."""


@dataclass
class Container:
    """One running container."""

    name: str
    process: subprocess.Popen[bytes]
    image: Mapping[str, Any]
    log: Path
    stop_seconds: float

    def kill(self) -> None:
        """Kill the program inside, as a lack of memory would."""
        os.kill(self._program(), signal.SIGKILL)
        self.process.wait(PATIENCE_SECONDS)

    def stop(self) -> int:
        """Stop as Compose does, and return the exit code; fails where SIGKILL would follow."""
        os.kill(self._program(), signal.Signals[self.image.get("StopSignal", "SIGTERM")])
        return self.process.wait(self.stop_seconds)

    def _program(self) -> int:
        assert self.process.poll() is None, f"{self.log.name} has ended by itself"
        # buildah, its runtime, its exec, and then the program, which is process 1 under Docker.
        found = self.process.pid
        for _ in range(3):
            (found,) = _children(found)
        return found


@dataclass
class Project:
    """All containers of the compose file, with the volumes that they share."""

    given: Mapping[str, str]
    """What ``docker/.env`` holds beside the example."""
    folder: Path
    running: list[Container] = field(default_factory=list)
    _volumes: dict[str, Path] = field(default_factory=dict)
    _containers: list[str] = field(default_factory=list)

    def start(self, service: str, command: Sequence[str] = ()) -> Container:
        """Start a service, with another command if one is given."""
        described = COMPOSE["services"][service]
        options = [*self._environment(described), *self._mounts(described)]
        grace = seconds(described.get("stop_grace_period", "10s"))
        return self.start_image(described["image"], command or described.get("command", ()), options, grace)

    def start_image(
        self, image: str, command: Sequence[str] = (), options: Sequence[str] = (), stop_seconds: float = 10.0
    ) -> Container:
        """Start an image as it is, or with another command and options of ``buildah run``."""
        config = json.loads(output(["buildah", "inspect", "--type", "image", image]))["Docker"]["config"]
        name = output(["buildah", "from", "--pull=never", "--add-host=postgres:127.0.0.1", image])
        self._containers.append(name)
        arguments = command or config.get("Cmd") or ()
        log = self.folder / f"{name}.log"
        with log.open("wb") as written:
            process = subprocess.Popen(
                [
                    "buildah",
                    "run",
                    "--isolation=chroot",
                    *options,
                    name,
                    "--",
                    *config["Entrypoint"],
                    *arguments,
                ],
                stdin=subprocess.DEVNULL,
                stdout=written,
                stderr=written,
            )
        container = Container(name, process, config, log, stop_seconds)
        self.running.append(container)
        return container

    def run(self, service: str, *command: str) -> tuple[int, str]:
        """Run a service to its end, and return its exit code and what it wrote."""
        container = self.start(service, command)
        code = container.process.wait(PATIENCE_SECONDS)
        self.running.remove(container)
        return code, container.log.read_text()

    def is_healthy(self, container: Container, service: str = "api") -> bool:
        """Ask what the compose file asks of a service, or else the image, inside the container."""
        check = COMPOSE["services"][service].get("healthcheck", {}).get("test")
        _, *command = check or container.image["Healthcheck"]["Test"]
        asked = [*RUN, container.name, "--", *command]
        return subprocess.run(asked, capture_output=True).returncode == 0

    def _environment(self, described: Mapping[str, Any]) -> list[str]:
        own = {
            name: interpolated(value, {**EXAMPLE, **self.given})
            for name, value in described.get("environment", {}).items()
        }
        from_file = {**EXAMPLE, **self.given} if "env_file" in described else {}
        return [f"--env={name}={value}" for name, value in {**from_file, **own}.items()]

    def _mounts(self, described: Mapping[str, Any]) -> list[str]:
        mounts = []
        for volume in described.get("volumes", []):
            name, _, place = volume.partition(":")
            if name not in self._volumes:
                self._volumes[name] = self._new_volume(name, place, described["image"])
            mounts.append(f"--volume={self._volumes[name]}:{place}")
        return mounts

    def _new_volume(self, name: str, place: str, image: str) -> Path:
        # A new volume begins with what the image has at its place.
        container = output(["buildah", "from", "--pull=never", image])
        try:
            root = output(["buildah", "mount", container])
            subprocess.run(["cp", "-a", f"{root}{place}", str(self.folder / name)], check=True)
        finally:
            output(["buildah", "rm", container])
        return self.folder / name

    def _clean_up(self) -> None:
        for container in self.running:
            # All of it at once: what is inside would outlive the processes that started it.
            for process in [*_descendants(container.process.pid), container.process.pid]:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(process, signal.SIGKILL)
            container.process.wait()
        for name in self._containers:
            output(["buildah", "rm", name])
        shutil.rmtree(self.folder)


@contextlib.contextmanager
def project(**given: str) -> Iterator[Project]:
    """Give a project that leaves no container and no volume behind."""
    folder = Path(tempfile.mkdtemp(prefix="polhode-containers-"))
    folder.chmod(0o755)  # the programs inside are not root
    ours = Project(given, folder)
    try:
        yield ours
    except BaseException:
        for container in ours.running:
            print(f"--- {container.log.name}\n{container.log.read_text(errors='replace')[-3000:]}")  # noqa: T201
        raise
    finally:
        ours._clean_up()


def _children(process: int) -> list[int]:
    # Any thread may have started them.
    try:
        listed = [file.read_text() for file in Path(f"/proc/{process}/task").glob("*/children")]
    except (FileNotFoundError, ProcessLookupError):
        return []
    return [int(child) for children in listed for child in children.split()]


def _descendants(process: int) -> list[int]:
    return [each for child in _children(process) for each in (child, *_descendants(child))]


def wait_until(what: str, condition: Callable[[], bool]) -> None:
    """Wait for a condition, or say what did not come."""
    deadline = time.monotonic() + PATIENCE_SECONDS
    while not condition():
        if time.monotonic() > deadline:
            raise AssertionError(f"waited in vain until {what}")
        time.sleep(0.2)
