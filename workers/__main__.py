"""``python -m workers``: installs signal handlers before the slow imports."""

import sys

from service.startup import collect_seldom, end_at_once, use_one_thread


def main() -> int:
    """Run the command line."""
    end_at_once(is_service=sys.argv[1:2] == ["run"])
    use_one_thread()
    collect_seldom()
    # Not at the top: the fork server of the children imports this module too, and needs no commands.
    from workers.cli.main import main as run  # noqa: PLC0415

    return run()


if __name__ == "__main__":
    sys.exit(main())
