"""API keys: their roles, their format, and whether they are valid.

A key's text is ``plh_``, a public prefix by which it is found and named, ``_``
and a secret of 256 bits. Only the SHA-256 of the whole text is kept. A slow
password hash would gain nothing: it protects secrets that can be guessed, which
256 random bits cannot.
"""

import hashlib
import hmac
import re
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum

_PREFIX_CHARACTERS = 12
_TEXT = re.compile(r"(plh_[0-9A-Za-z]{8})_[0-9A-Za-z]{43}", re.ASCII)


class Role(StrEnum):
    """The permissions of a key; each role includes all roles before it."""

    METRICS = "metrics"
    """Read the metrics of the installation, and nothing else: for a program that scrapes them."""
    READ = "read"
    """Read everything, and ask for verdicts, which store nothing."""
    SUBMIT = "submit"
    """Submit jobs, and cancel what was submitted with the same key."""
    OPERATE = "operate"
    """Cancel anything."""
    ADMIN = "admin"
    """Manage keys."""

    def may(self, needed: "Role") -> bool:
        """Tell whether this role includes ``needed``."""
        roles = list(Role)
        return roles.index(self) >= roles.index(needed)


class KeyStanding(StrEnum):
    """Whether a key is valid at some instant."""

    LIVE = "live"
    EXPIRED = "expired"
    REVOKED = "revoked"


@dataclass(frozen=True, slots=True)
class ApiKey:
    """A key as stored, without its secret. Instants are UTC by the database's clock."""

    id: str
    prefix: str
    """The public prefix, which names it."""
    hash: bytes = field(repr=False)
    name: str
    role: Role
    created_at: datetime
    expires_at: datetime | None
    revoked_at: datetime | None
    last_used_at: datetime | None
    """May lag by up to a minute."""
    requests_per_second: float | None
    """None, here and below: the limit of the installation's settings."""
    max_queued_jobs: int | None
    max_stored_bytes: int | None
    stored_bytes: int
    """Bytes of the arrays computed for it."""

    def standing(self, now: datetime) -> KeyStanding:
        """Return whether the key is valid at ``now``; a revoked one never is again."""
        if self.revoked_at is not None:
            return KeyStanding.REVOKED
        if self.expires_at is not None and now >= self.expires_at:
            return KeyStanding.EXPIRED
        return KeyStanding.LIVE

    def opens_with(self, text: str) -> bool:
        """Tell whether ``text`` is this key, by a constant-time comparison."""
        return hmac.compare_digest(self.hash, key_hash(text))


class KeyNotFoundError(LookupError):
    """There is no key of that prefix."""

    def __init__(self, prefix: str) -> None:
        # Somebody may have pasted the whole key; the secret part must not appear in the message.
        self.prefix = prefix[:_PREFIX_CHARACTERS]
        super().__init__(f"there is no key {self.prefix}; `polhode keys list` shows all keys")


def key_prefix(text: str) -> str | None:
    """Return the public prefix of a key, None if the text cannot be one."""
    match = _TEXT.fullmatch(text)
    return None if match is None else match[1]


def key_hash(text: str) -> bytes:
    """Return the hash of a key, which is stored in its place."""
    return hashlib.sha256(text.encode()).digest()
