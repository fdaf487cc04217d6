from tests.support.api import app, client, stored

__all__ = ["app", "client", "stored"]
