"""Commands of ``polhode`` in the process of a test, also the part of them that a worker does."""

import os
from collections.abc import Mapping
from typing import NoReturn
from unittest.mock import patch

from service.cli import commands
from workers.cli.main import main


class _Became(BaseException):
    """The process would now be another program."""

    def __init__(self, arguments: list[str], environment: Mapping[str, str]) -> None:
        self.arguments, self.environment = arguments, environment


def _become(_: str, command: list[str], environment: Mapping[str, str]) -> NoReturn:
    raise _Became(command[command.index("workers") + 1 :], environment)


def polhode(*arguments: object) -> int:
    """Run a command; return its exit code."""
    # Signals are held back between two programs only.
    with patch("os.execve", _become), patch("service.cli.common.hold_signals"):
        try:
            commands.app(list(map(str, arguments)))
        except SystemExit as end:
            return int(end.code or 0)
        except _Became as became:
            worker = became
    with patch.dict(os.environ, worker.environment):
        return main(worker.arguments)
