"""Requests that a client may send twice: the key that it chose, and the answer that it was given."""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

KEPT_SECONDS = 86400.0
"""How long an answer is given again."""

Made = TypeVar("Made")


@dataclass(frozen=True, slots=True)
class GivenKey:
    """The Idempotency-Key of a request."""

    principal: str
    """Id of the API key that sent it, empty if there are no keys: nobody can use another's keys."""
    key: str
    fingerprint: str
    """Hash of method, path, query and body: the same key with another request is a mistake."""


@dataclass(frozen=True, slots=True)
class GivenAnswer:
    """An answer as it was sent."""

    status: int
    headers: Mapping[str, str]
    body: bytes


@dataclass(frozen=True, slots=True)
class Receipt(Generic[Made]):
    """The key and the answer, which a store writes in the transaction that makes something."""

    given: GivenKey
    answer: Callable[[Made], GivenAnswer]


class KeyTakenError(Exception):
    """Another request with the same key was committed first; nothing was stored for this one."""


def fingerprint(*parts: bytes) -> str:
    """Return the fingerprint of a request by its parts."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(len(part).to_bytes(8, "big") + part)
    return digest.hexdigest()
