"""Reads documents and writes results for the commands: files, stdin, stdout and stderr.

Every error about a file is one line. ``-`` means stdin for reading and stdout for
writing.
"""

import json
import os
import re
import sys
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self, TextIO

from service.logs import printable
from service.schemas.reading.documents import InvalidJsonError, parse_json

STANDARD_STREAM = Path("-")

MAX_DOCUMENT_BYTES = 50_000_000
"""More than the service accepts, since sweeps may list their values; bounded to protect the memory."""

_SPACE = re.compile(r"[ \t\r\n]*")
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


def read_items(path: Path) -> tuple[bool, Iterator[object]]:
    """Return whether a file has a list, and its documents: of a JSON list, of NDJSON, or the only one.

    They are parsed as they are taken, by the rules of the service for a document; the list itself may have
    any length. In the place of what is no JSON document there is its :class:`FileFaultError`.

    Raises
    ------
    FileFaultError
        The file cannot be read, or has nothing in it.
    """
    name = "stdin" if path == STANDARD_STREAM else str(path)
    try:
        file = _open(path)
        first = _first_line(file)
    except OSError as fault:
        raise FileFaultError(f"{name}: {_reason(fault)}") from fault
    if not first.strip():
        raise FileFaultError(f"{name}: the file is empty; a JSON document is expected")
    if first.lstrip()[:1] == b"[":
        return True, _of_list(name, file, first)
    try:
        parse_json(first)
    except InvalidJsonError:
        first += _rest(file, MAX_DOCUMENT_BYTES + 1)
        return False, iter([_parsed(name, "", first)])
    second = _first_line(file)
    if not second.strip():
        _rest(file)
        return False, iter([_parsed(name, "", first)])
    return True, _of_lines(name, file, [first, second])


def _open(path: Path) -> BinaryIO:
    if path != STANDARD_STREAM:
        return path.open("rb")
    if sys.stdin is None:
        raise FileFaultError("stdin: it is closed")
    return sys.stdin.buffer


def _first_line(file: BinaryIO) -> bytes:
    """Return the first line that is not blank; a line is no longer than a document may be."""
    while (line := file.readline(MAX_DOCUMENT_BYTES + 1)) and not line.strip():
        pass
    return line


def _rest(file: BinaryIO, most: int = -1) -> bytes:
    """Return what is left of a file, and close it."""
    content = file.read(most)
    if file is not getattr(sys.stdin, "buffer", None):
        file.close()
    return content


def _of_lines(name: str, file: BinaryIO, first: Iterable[bytes]) -> Iterator[object]:
    for index, line in enumerate(line for line in chain(first, file) if line.strip()):
        yield _parsed(name, f"number {index}: ", line)
    _rest(file)


def _of_list(name: str, file: BinaryIO, first: bytes) -> Iterator[object]:
    """Yield the items of a JSON list one by one; where one ends it is looked up without making it."""
    try:
        text = (first + _rest(file)).decode()
    except UnicodeDecodeError:
        yield FileFaultError(f"{name}: the file is not UTF-8")
        return
    find, place, index = json.JSONDecoder().raw_decode, text.index("[") + 1, 0
    while True:
        place = _SPACE.match(text, place).end()  # type: ignore[union-attr]  # it matches nothing, too
        if text[place : place + 1] == "]" and not text[place + 1 :].strip():
            return
        try:
            _, end = find(text, place)
        except (ValueError, RecursionError):
            yield FileFaultError(
                f"{name}: number {index}: it is no JSON document, and what follows is not read"
            )
            return
        yield _parsed(name, f"number {index}: ", text[place:end].encode())
        place, index = _SPACE.match(text, end).end(), index + 1  # type: ignore[union-attr]
        if text[place : place + 1] == ",":
            place += 1
        elif text[place : place + 1] != "]":
            yield FileFaultError(
                f"{name}: number {index}: a comma or ] is expected, and what follows is not read"
            )
            return


def _parsed(name: str, place: str, content: bytes) -> object:
    if len(content) > MAX_DOCUMENT_BYTES:
        return FileFaultError(f"{name}: {place}too large; at most {MAX_DOCUMENT_BYTES} bytes are accepted")
    try:
        return parse_json(content)
    except InvalidJsonError as fault:
        return FileFaultError(f"{name}: {place}{fault}")


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
