"""Runs a service as long as another program lives: ``python -m polhode.keeper FOLDER COMMAND...``.

The other program holds the write end of our stdin. However it ends, the system closes it; then the
service is asked to end, and the folder is deleted.
"""

import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path

_PATIENCE_SECONDS = 20.0


def main() -> int:
    """Return the exit code of the command."""
    folder, *command = sys.argv[1:]
    with (Path(folder) / "log").open("wb") as log:
        service = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, cwd=folder)
    threading.Thread(target=_end_with_stdin, args=(service,), daemon=True).start()
    code = service.wait()
    if _was_asked.is_set():
        shutil.rmtree(folder, ignore_errors=True)
    return code


_was_asked = threading.Event()
"""Whether the other program has ended, or asked for the end; if not, it still reads the log."""


def _end_with_stdin(service: "subprocess.Popen[bytes]") -> None:
    # Not by sys.stdin: a thread that holds its lock would abort the interpreter at its end.
    while os.read(0, 1):
        pass
    _was_asked.set()
    service.terminate()
    try:
        service.wait(_PATIENCE_SECONDS)
    except subprocess.TimeoutExpired:
        service.kill()


if __name__ == "__main__":
    sys.exit(main())
