"""Keys: what their holders may do."""

from enum import StrEnum


class Role(StrEnum):
    """What a key is good for; each role may do all that the ones before it may."""

    READ = "read"
    SUBMIT = "submit"
    OPERATE = "operate"
    ADMIN = "admin"
