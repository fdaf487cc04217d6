"""Entry point of ``polhode``: installs signal handlers before the slow imports."""

import sys
from io import TextIOWrapper

from service.startup import collect_seldom, end_at_once

_SERVICES = (["serve"], ["worker"])


def main() -> None:
    """Run the command line."""
    end_at_once(is_service=sys.argv[1:2] in _SERVICES)
    collect_seldom()
    for stream in (sys.stdout, sys.stderr):
        # Encodings such as cp1252 lack letters of help and messages; no stream at all is None.
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    from service.cli.commands import run  # noqa: PLC0415

    run()
