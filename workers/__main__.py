"""``python -m workers``."""

import sys

if __name__ == "__main__":
    # Here, since the fork server of the children imports this module too: it needs no commands.
    from workers.commands import main

    sys.exit(main())
