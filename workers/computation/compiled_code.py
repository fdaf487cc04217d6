"""Finds and checks the folder that caches compiled code, and passes it to the solvers.

It is looked for here and not in the solvers, which are pure, and not in the worker process, since jobs are
also solved without one: by commands, calibrations and tests.
"""

import hashlib
import os
from functools import cache
from pathlib import Path

from service.versions import version_of
from workers.solvers import compiled
from workers.solvers.compiled import code_folder

FOLDER_VARIABLE = "NUMBA_CACHE_DIR"
"""Names another folder; it must belong to us, since what is in it is run."""


@cache
def keep_compiled_code() -> None:
    """Have compiled solvers keep their code; whoever calls them calls this before the first call.

    Raises
    ------
    OtherFolderError
        They keep it in another folder already.
    """
    folder = own_folder()
    code_folder.hand_in(None if folder is None else str(folder))


def own_folder() -> Path | None:
    """Return the folder, made where it is missing; None if there is none that only we can write to."""
    folder = _base() / f"compiled-{digest(Path(compiled.__path__[0]))}"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        about = folder.stat()
    except OSError:
        return None
    is_ours = about.st_uid == os.getuid() and not about.st_mode & 0o022
    return folder if is_ours and os.access(folder, os.W_OK) else None


def _base() -> Path:
    named = os.environ.get(FOLDER_VARIABLE)
    if named:
        return Path(named)
    caches = os.environ.get("XDG_CACHE_HOME")
    # The method of Path raises where nobody knows a home.
    home = os.path.expanduser("~")  # noqa: PTH111
    return (Path(caches) if caches else Path(home, ".cache")) / "polhode"


def digest(package: Path) -> str:
    """Return a digest of all sources of a package and of the compiler's version.

    A kernel contains the kernels it calls: compiled code is good for one state of all of them.
    """
    total = hashlib.sha256(version_of("numba").encode())
    for source in sorted(package.rglob("*.py")):
        total.update(source.relative_to(package).as_posix().encode() + b"\0")
        total.update(source.read_bytes())
    return total.hexdigest()[:16]
