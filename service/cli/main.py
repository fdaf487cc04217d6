"""Entry point of ``polhode``: installs signal handlers before the slow imports."""

import sys

from service.startup import collect_seldom
from service.stopping import end_at_once

_SERVICES = (["serve"], ["worker"])


def main() -> None:
    """Run the command line."""
    end_at_once(is_service=sys.argv[1:2] in _SERVICES)
    collect_seldom()
    from service.cli.commands import run  # noqa: PLC0415

    run()
