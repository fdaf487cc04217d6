"""Build the images that ``docker/compose.yaml`` names, from Debian packages alone and without a daemon.

Buildah builds with chroot isolation: that needs root and nothing else, no
registry of images among them. ``debootstrap`` makes the base, under the name
that the Dockerfile takes; it is what the image of that name holds.
"""

import subprocess
import tempfile
from collections.abc import Iterable
from pathlib import Path

TOP = Path(__file__).parents[2]
HERE = Path(__file__).parent
MIRROR = "http://deb.debian.org/debian"
BASE = "docker.io/library/debian:trixie-slim"
POSTGRES = "docker.io/library/postgres:17-trixie"
POLHODE = "localhost/polhode"
CERTIFICATES = Path("/etc/ssl/certs/ca-certificates.crt")
# Where the build sees this machine's certificates, and the settings that lead pip to them. Not where Debian's
# package ca-certificates writes its own: a file that is mounted cannot be replaced, and installing it failed.
TRUSTED = "/run/trusted-certificates.crt"
PIP_SETTINGS = "/etc/pip.conf"
LEFT_OUT = ("./dev/*", "./proc/*", "./sys/*", "./var/cache/apt/archives/*.deb", "./var/lib/apt/lists/*")


def build_all() -> None:
    """Build the base unless there is one, a stand-in for the image of Postgres, and the service's image."""
    if not exists(BASE):
        build_base()
    if not exists(POSTGRES):
        _build(HERE / "Dockerfile.postgres", HERE, POSTGRES)
    _build(TOP / "docker" / "Dockerfile", TOP, POLHODE)


def exists(image: str) -> bool:
    """Tell whether this machine has the image."""
    found = subprocess.run(["buildah", "inspect", "--type", "image", image], capture_output=True)
    return found.returncode == 0


def build_base() -> None:
    """Install Debian's smallest system into a folder, and make it the base image."""
    with tempfile.TemporaryDirectory(prefix="base") as folder:
        system, archive = Path(folder, "system"), Path(folder, "system.tar")
        run(["debootstrap", "--variant=minbase", "trixie", str(system), MIRROR])
        excluded = [f"--exclude={pattern}" for pattern in LEFT_OUT]
        run(["tar", "--directory", str(system), *excluded, "--create", "--file", str(archive), "."])
        container = output(["buildah", "from", "scratch"])
        try:
            run(["buildah", "add", "--quiet", container, str(archive), "/"])
            run(["buildah", "config", "--cmd", "bash", container])
            run(["buildah", "commit", "--quiet", container, BASE])
        finally:
            run(["buildah", "rm", container])


def _build(file: Path, context: Path, tag: str) -> None:
    command = ["buildah", "build", "--isolation=chroot", "--format=docker", "--pull=never"]
    with tempfile.TemporaryDirectory(prefix="trusted") as folder:
        run([*command, *_certificates(Path(folder)), f"--file={file}", f"--tag={tag}", str(context)])


def _certificates(folder: Path) -> list[str]:
    # pip in the build trusts the certificates that this machine trusts; nothing of them stays in the image.
    if not CERTIFICATES.exists():
        return []
    settings = folder / "pip.conf"
    settings.write_text(f"[global]\ncert = {TRUSTED}\n", encoding="utf-8")
    settings.chmod(0o644)
    folder.chmod(0o755)
    return [f"--volume={CERTIFICATES}:{TRUSTED}:ro", f"--volume={settings}:{PIP_SETTINGS}:ro"]


def run(command: Iterable[str]) -> None:
    """Run a command whose output people see."""
    subprocess.run(list(command), check=True, stdin=subprocess.DEVNULL)


def output(command: Iterable[str]) -> str:
    """Run a command and return what it writes."""
    return subprocess.run(list(command), check=True, capture_output=True, text=True).stdout.strip()
