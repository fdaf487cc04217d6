"""Keys: what their holders may do, and whether they still hold.

A key's text is ``plh_``, a public part by which it is found and called, ``_``
and a secret of 256 bits. Only the SHA-256 of the whole text is kept. A slow
password hash would gain nothing: it protects secrets that can be guessed, and
nobody guesses 256 random bits.
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
    """What a key is good for; each role may do all that the ones before it may."""

    READ = "read"
    """Look at everything."""
    SUBMIT = "submit"
    """Have things computed, and cancel what was submitted with the same key."""
    OPERATE = "operate"
    """Cancel anything, and see how the installation fares."""
    ADMIN = "admin"
    """Whatever concerns keys."""

    def may(self, needed: "Role") -> bool:
        """Tell whether this role is enough where ``needed`` is."""
        roles = list(Role)
        return roles.index(self) >= roles.index(needed)


class KeyStanding(StrEnum):
    """Whether a key is good at some instant."""

    LIVE = "live"
    EXPIRED = "expired"
    REVOKED = "revoked"


@dataclass(frozen=True, slots=True)
class ApiKey:
    """A key as stored, without its secret. Instants are UTC by the database's clock."""

    id: str
    prefix: str
    """The public part, by which it is called."""
    hash: bytes = field(repr=False)
    name: str
    role: Role
    created_at: datetime
    expires_at: datetime | None
    revoked_at: datetime | None
    last_used_at: datetime | None
    """Behind by up to a minute."""
    requests_per_second: float | None
    """None, here and below: what the installation's settings say."""
    max_queued_jobs: int | None
    max_stored_bytes: int | None
    stored_bytes: int
    """Of the arrays computed for it."""

    def standing(self, now: datetime) -> KeyStanding:
        """Return whether the key is good now; a revoked one is so for ever."""
        if self.revoked_at is not None:
            return KeyStanding.REVOKED
        if self.expires_at is not None and now >= self.expires_at:
            return KeyStanding.EXPIRED
        return KeyStanding.LIVE

    def opens_with(self, text: str) -> bool:
        """Tell whether ``text`` is this key; the time it takes says nothing about the hash."""
        return hmac.compare_digest(self.hash, key_hash(text))


class KeyNotFoundError(LookupError):
    """There is no key of that prefix."""

    def __init__(self, prefix: str) -> None:
        # Somebody may have pasted more than the prefix, which nobody else should read.
        self.prefix = prefix[:_PREFIX_CHARACTERS]
        super().__init__(f"there is no key {self.prefix}; `polhode keys list` shows those there are")


def key_prefix(text: str) -> str | None:
    """Return the public part of a key, None if the text cannot be one."""
    match = _TEXT.fullmatch(text)
    return None if match is None else match[1]


def key_hash(text: str) -> bytes:
    """Return what is stored of a key."""
    return hashlib.sha256(text.encode()).digest()
