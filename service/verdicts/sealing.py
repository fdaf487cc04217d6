"""Seals kept entries with a checksum, so that one that was damaged is noticed and found anew."""

import hashlib


def seal_of(key: str, content: bytes) -> str:
    """Return the checksum, in hexadecimal, of an entry; it covers the key: entries cannot be swapped."""
    return hashlib.sha256(key.encode() + b"\n" + content).hexdigest()


def is_sound(key: str, content: bytes, seal: str) -> bool:
    """Tell whether an entry is as it was when it was sealed."""
    return seal_of(key, content) == seal
