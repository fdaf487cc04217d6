"""What commands read and write for a person: documents, answers and the files they ask for.

Every fault of a file is one line. ``-`` is stdin where a document is read and
stdout where a file is written.
"""

import os
import sys
from pathlib import Path
from types import TracebackType
from typing import Self, TextIO

from service.escaping import printable
from service.schemas.strict_json import InvalidJsonError, parse_json

STANDARD_STREAM = Path("-")

MAX_DOCUMENT_BYTES = 50_000_000
"""More than the service accepts, since sweeps may list their values; less than would fill the memory."""

_WRITING = os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC
_PERMISSIONS = 0o666  # of a new file, but for those that the umask takes away


class FileFaultError(Exception):
    """A file cannot be read or written; the message is one line that names it."""


def say(line: str) -> None:
    """Tell a person something; stdout is for answers."""
    sys.stderr.write(f"{printable(line)}\n")


def answer(text: str) -> None:
    """Write to stdout, now.

    Raises
    ------
    FileFaultError
        Nobody reads it any more, or there is no room for it.
    """
    stdout = _stdout()
    encoding = stdout.encoding or "utf-8"
    # The stream may not know every character.
    written = printable(text).encode(encoding, "backslashreplace").decode(encoding)
    try:
        stdout.write(written)
        stdout.flush()
    except OSError as fault:
        _forget_stdout()
        raise FileFaultError(f"stdout: {_reason(fault)}") from fault


def read_document(path: Path) -> object:
    """Return the JSON document of a file, by the rules of the service.

    Raises
    ------
    FileFaultError
        The file cannot be read, or holds no document.
    """
    name = "stdin" if path == STANDARD_STREAM else str(path)
    try:
        content = _content(path)
    except OSError as fault:
        raise FileFaultError(f"{name}: {_reason(fault)}") from fault
    if len(content) > MAX_DOCUMENT_BYTES:
        raise FileFaultError(f"{name}: too large; at most {MAX_DOCUMENT_BYTES} bytes are accepted")
    if not content.strip():
        raise FileFaultError(f"{name}: it is empty; a JSON document is accepted")
    try:
        return parse_json(content)
    except InvalidJsonError as fault:
        raise FileFaultError(f"{name}: {fault}") from fault


def _content(path: Path) -> bytes:
    """Read no more than one byte too many: the file may be endless."""
    if path == STANDARD_STREAM:
        if sys.stdin is None:
            raise FileFaultError("stdin: it is closed")
        return sys.stdin.buffer.read(MAX_DOCUMENT_BYTES + 1)
    with path.open("rb") as file:
        return file.read(MAX_DOCUMENT_BYTES + 1)


def check_writable(path: Path) -> None:
    """Find out, before there is anything to write, what is wrong with a file; leave it as it is.

    Raises
    ------
    FileFaultError
        It cannot be opened.
    """
    if path == STANDARD_STREAM:
        _stdout()
        return
    try:
        is_new = not path.exists()
        if not is_new and path.is_fifo():
            return  # its reader would see an end
        os.close(os.open(path, _WRITING, _PERMISSIONS))
        if is_new:
            path.unlink()
    except OSError as fault:
        raise FileFaultError(f"{path}: {_reason(fault)}") from fault


class OutputFile:
    """A file to write; an older one of that name is emptied.

    Raises
    ------
    FileFaultError
        It cannot be opened; so the methods, if it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.name = "stdout" if path == STANDARD_STREAM else str(path)
        self.closed = False
        try:
            if path == STANDARD_STREAM:
                self._descriptor = os.dup(_stdout().fileno())
            else:
                self._descriptor = os.open(path, _WRITING | os.O_TRUNC, _PERMISSIONS)
        except OSError as fault:
            raise FileFaultError(f"{self.name}: {_reason(fault)}") from fault

    def write(self, content: bytes) -> int:
        """Write all of ``content``; return its length."""
        rest = memoryview(content)
        try:
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
        except OSError as fault:
            raise FileFaultError(f"{self.name}: {_reason(fault)}") from fault
        return len(content)

    def flush(self) -> None:
        """Do nothing: there is no buffer."""

    def close(self) -> None:
        """Close it; what could not be kept by a file system elsewhere is told now."""
        if self.closed:
            return
        self.closed = True
        try:
            os.close(self._descriptor)
        except OSError as fault:
            raise FileFaultError(f"{self.name}: {_reason(fault)}") from fault

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _stdout() -> TextIO:
    if sys.stdout is None:
        raise FileFaultError("stdout: it is closed")
    return sys.stdout


def _reason(fault: OSError) -> str:
    return fault.strerror or str(fault)


def _forget_stdout() -> None:
    """Give what is left in the buffer of stdout to nobody: else the interpreter tries again at its end."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)
