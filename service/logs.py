"""Logging of all processes: text lines for people, or one JSON object per line for programs.

:func:`about` adds fields (the request, the job) to every record made inside it.
Passwords in URLs and keys are masked in everything that is written, and characters
that could control a terminal or forge a line are escaped.
"""

import json
import logging
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from datetime import UTC, datetime
from traceback import walk_tb
from types import MappingProxyType, TracebackType
from typing import Literal, TypeVar, TypeVarTuple, get_args

LogFormat = Literal["json", "text"]
LogLevel = Literal["critical", "error", "warning", "info", "debug"]
LOG_LEVELS: tuple[LogLevel, ...] = get_args(LogLevel)

OURS = ("service", "workers")
"""Loggers that get the chosen level; libraries log warnings and worse only."""

SECONDS_BETWEEN_LINES = 10.0
"""Least time between two lines about the same trouble, which many clients or a loop may have."""

T = TypeVar("T")
Arguments = TypeVarTuple("Arguments")
_Details = tuple[type[BaseException], BaseException, TracebackType | None]

_SECRETS = (
    (re.compile(r"(://[^\s:/@]*):[^\s@]+@"), r"\1:***@"),
    # A masked key keeps its public prefix, which names it.
    (re.compile(r"\b(plh_[0-9A-Za-z]{8}_)[0-9A-Za-z]+"), r"\1***"),
    (re.compile(r"(?i)\b(bearer)\s+(?!plh_)\S+"), r"\1 ***"),
)
_SIGNS = re.compile(r"(?i)://|plh_|bearer")
_context: ContextVar[Mapping[str, object]] = ContextVar("about", default=MappingProxyType({}))


@dataclass(frozen=True, slots=True)
class Logging:
    """The format and the level of a process's log."""

    format: LogFormat
    level: LogLevel


@contextmanager
def about(**fields: object) -> Iterator[None]:
    """Add these fields to every record made inside, in this thread or task."""
    token = _context.set({**_context.get(), **fields})
    try:
        yield
    finally:
        _context.reset(token)


def call_about(
    fields: Mapping[str, object], function: Callable[[*Arguments], T], *arguments: *Arguments
) -> T:
    """Call a function within :func:`about`; at module level, so that child processes can call it."""
    with about(**fields):
        return function(*arguments)


class Complaints:
    """Logs at most one line of a kind in so many seconds, and counts the suppressed ones."""

    def __init__(self, logger: logging.Logger, clock: Callable[[], float] = time.monotonic) -> None:
        self._logger, self._clock = logger, clock
        self._silent_until: dict[str, float] = {}
        self._kept_back: dict[str, int] = {}

    def tell(
        self,
        message: str,
        fault: BaseException | None = None,
        *,
        kind: str | None = None,
        level: int = logging.WARNING,
    ) -> None:
        """Log a message, with the trace of a fault, unless one of its kind was logged too recently.

        Without a ``kind`` equal messages are of one. There must be few kinds: each is kept.
        """
        now, kind = self._clock(), kind or message
        if now < self._silent_until.get(kind, now):
            self._kept_back[kind] = self._kept_back.get(kind, 0) + 1
            return
        others = self._kept_back.pop(kind, 0)
        self._silent_until[kind] = now + SECONDS_BETWEEN_LINES
        more = f" ({others} times more since the last line)" if others else ""
        self._logger.log(level, "%s%s", message, more, exc_info=fault)


def place_of(fault: BaseException) -> str:
    """Return the kind of a fault: its class, and the line that raised it."""
    *_, (frame, line) = [(None, 0), *walk_tb(fault.__traceback__)]
    where = "" if frame is None else f" at {frame.f_code.co_filename}:{line}"
    return f"{type(fault).__name__}{where}"


def start_logging(chosen: LogFormat | None, level: LogLevel) -> Logging:
    """Write this process's log to stderr; the default format is text on a terminal and JSON elsewhere."""
    form: LogFormat = chosen or ("text" if sys.stderr.isatty() else "json")
    handler = _Handler(Logging(form, level))
    root = logging.getLogger()
    root.handlers[:] = [handler]
    number = logging.getLevelNamesMapping()[level.upper()]
    root.setLevel(max(number, logging.WARNING))
    for name in OURS:
        logging.getLogger(name).setLevel(number)
    logging.captureWarnings(True)
    sys.excepthook = _uncaught
    threading.excepthook = _uncaught_in_thread
    return handler.logging


def current_logging() -> Logging | None:
    """Return the arguments of this process's :func:`start_logging`, for use in its children."""
    settings = [handler.logging for handler in logging.getLogger().handlers if isinstance(handler, _Handler)]
    return settings[0] if settings else None


def announce(line: str) -> None:
    """Write a line to the person who started this process; as a record if the log is JSON."""
    how = current_logging()
    if how is not None and how.format == "json":
        record = logging.LogRecord(OURS[0], logging.INFO, "", 0, line, None, None)
        line = _JsonFormatter().format(record)
    sys.stderr.write(f"{one_line(line)}\n")


def mask(text: str) -> str:
    """Return ``text`` without the passwords of URLs and without keys."""
    # Nearly all texts have none of the words that every secret has, which is found much sooner.
    if _SIGNS.search(text) is not None:
        for pattern, replacement in _SECRETS:
            text = pattern.sub(replacement, text)
    return text


class _Handler(logging.Handler):
    def __init__(self, how: Logging) -> None:
        super().__init__()
        self.logging = how
        self.setFormatter(_JsonFormatter() if how.format == "json" else _TextFormatter())

    def emit(self, record: logging.LogRecord) -> None:
        """Write each line by one call, so that lines of processes that share the stream are not mixed."""
        try:
            sys.stderr.write(self.format(record) + "\n")
            sys.stderr.flush()
        except Exception:  # a log that cannot be written must not stop any work
            self.handleError(record)


class _JsonFormatter(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        """Return one line of JSON."""
        line: dict[str, object] = {
            "time": _instant(record),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": mask(record.getMessage()),
            **_fields(record),
        }
        if record.exc_info:
            line["exception"] = mask(self.formatException(record.exc_info))
        # Escaped to ASCII: half of a surrogate pair could not be encoded otherwise.
        return json.dumps(line, default=str)


class _TextFormatter(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        """Return a line, with the lines of the exception indented so that none looks like a record."""
        fields = "".join(f" {name}={value}" for name, value in _fields(record).items())
        line = f"{_instant(record)} {record.levelname} {record.name}: {record.getMessage()}{fields}"
        lines = [one_line(mask(line))]
        if record.exc_info:
            below = mask(self.formatException(record.exc_info)).split("\n")
            lines += [f"    {one_line(each)}" for each in below]
        return "\n".join(lines)


def _fields(record: logging.LogRecord) -> dict[str, object]:
    """Return the fields of the context and those given with ``extra={"fields": …}``."""
    extra: Mapping[str, object] = getattr(record, "fields", {})
    fields = {**_context.get(), **extra}
    return {name: mask(value) if isinstance(value, str) else value for name, value in fields.items()}


def _instant(record: logging.LogRecord) -> str:
    moment = datetime.fromtimestamp(record.created, UTC)
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _uncaught(kind: type[BaseException], fault: BaseException, trace: TracebackType | None) -> None:
    if issubclass(kind, KeyboardInterrupt):
        sys.__excepthook__(kind, fault, trace)
        return
    details: _Details = (kind, fault, trace)
    logging.getLogger(OURS[0]).critical("the process ends: %s", kind.__name__, exc_info=details)


def _uncaught_in_thread(hook: threading.ExceptHookArgs) -> None:
    if hook.exc_value is None or isinstance(hook.exc_value, SystemExit):
        return
    details: _Details = (hook.exc_type, hook.exc_value, hook.exc_traceback)
    name = hook.thread.name if hook.thread else "?"
    logging.getLogger(OURS[0]).critical("the thread %s ends", name, exc_info=details)


def one_line(text: str) -> str:
    """Return ``text`` with every character escaped that is neither printable nor a space.

    Text from clients may be part of it: line breaks would forge log lines, escape
    sequences control a terminal, and direction marks change the order in which
    text is shown. "Printable" is meant as Unicode defines it.
    """
    if text.isprintable():
        return text
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode("ascii")
        for character in text
    )


def printable(text: str) -> str:
    """Escape like :func:`one_line` but keep line breaks: for text whose lines this program wrote."""
    return "\n".join(map(one_line, text.split("\n")))
