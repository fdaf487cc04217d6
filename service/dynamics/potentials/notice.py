"""What a client should know about a potential that is not wrong, only surprising."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Notice:
    """A remark with a stable ``code``, a sentence, and the place it speaks about (a JSON pointer)."""

    code: str
    message: str
    pointer: str
