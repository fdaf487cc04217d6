"""Keys for tests, and the header that shows them."""

from service.jobs.keys import ApiKey, Role
from service.storage.keys import KeyLimits, KeyStore


class Clock:
    """A clock that stands still until it is moved."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


def header(text: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {text}"}


def make(database, role: Role, **limits) -> tuple[ApiKey, dict[str, str]]:
    """Make a key, and return it with its header."""
    key, text = KeyStore(database).create(role, limits=KeyLimits(**limits))
    return key, header(text)
