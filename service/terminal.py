"""Reads documents and writes results for the commands: files, stdin, stdout and stderr.

Every error about a file is one line. ``-`` means stdin for reading and stdout for
writing.
"""

import os
import sys
from pathlib import Path
from types import TracebackType
from typing import Self, TextIO

from service.logs import printable
from service.schemas.reading.documents import InvalidJsonError, parse_json

STANDARD_STREAM = Path("-")

MAX_DOCUMENT_BYTES = 50_000_000
"""More than the service accepts, since sweeps may list their values; bounded to protect the memory."""

_WRITING = os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC
_PERMISSIONS = 0o666  # mode of a new file, before the umask


class FileFaultError(Exception):
    """A file cannot be read or written; the message is one line that names it."""


def say(line: str) -> None:
    """Write a message to stderr; stdout is for results."""
    sys.stderr.write(f"{printable(line)}\n")


def answer(text: str) -> None:
    """Write to stdout, now.

    Raises
    ------
    FileFaultError
        The reader has closed the pipe, or the disk is full.
    """
    stdout = _stdout()
    encoding = stdout.encoding or "utf-8"
    # The encoding of the stream may lack a character.
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
        The file cannot be read, or is not a JSON document.
    """
    name = "stdin" if path == STANDARD_STREAM else str(path)
    try:
        content = _content(path)
    except OSError as fault:
        raise FileFaultError(f"{name}: {_reason(fault)}") from fault
    if len(content) > MAX_DOCUMENT_BYTES:
        raise FileFaultError(f"{name}: too large; at most {MAX_DOCUMENT_BYTES} bytes are accepted")
    if not content.strip():
        raise FileFaultError(f"{name}: the file is empty; a JSON document is expected")
    try:
        return parse_json(content)
    except InvalidJsonError as fault:
        raise FileFaultError(f"{name}: {fault}") from fault


def _content(path: Path) -> bytes:
    """Read at most one byte beyond the limit: the file may be endless."""
    if path == STANDARD_STREAM:
        if sys.stdin is None:
            raise FileFaultError("stdin: it is closed")
        return sys.stdin.buffer.read(MAX_DOCUMENT_BYTES + 1)
    with path.open("rb") as file:
        return file.read(MAX_DOCUMENT_BYTES + 1)


def check_writable(path: Path) -> None:
    """Check early that a file can be written, without changing it.

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
            return  # opening and closing a pipe would show its reader an end of file
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
        It cannot be opened; the methods raise it if the file cannot be written.
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
        """Close it; a network file system may report a failed write only now."""
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
    """Discard what is left in the buffer of stdout; otherwise the interpreter tries to write it at exit."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)
