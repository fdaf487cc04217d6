from tests.support.api import app, client, stored, verdicts

__all__ = ["app", "client", "stored", "verdicts"]
