"""Reads the names that queries hold: facts, JSON pointers and labels."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches

from service.schemas.query.conditions import Subject
from service.schemas.query.facts import LONGEST_POINTER, Fact
from service.schemas.query.kinds import Kind
from service.schemas.query.splitting import Excerpt, QueryError
from service.schemas.reading.marks import LABEL_KEY, LABEL_KEYS

LABEL = "label."
_POINTER = re.compile(r"/[^\x00\ud800-\udfff]+\Z")


@dataclass(frozen=True, slots=True)
class Vocabulary:
    """The names that queries of one list may use."""

    facts: Mapping[str, Fact]
    has_pointers: bool = False
    """Any JSON pointer into the problem, beside the facts."""
    has_labels: bool = False

    def accepted(self) -> str:
        """Return the phrase that names what is accepted."""
        names = list(self.facts)
        if self.has_pointers:
            names.append("pointers to numbers of the problem such as /motion/lambda")
        if self.has_labels:
            names.append("label.KEY")
        return f"accepted are {', '.join(names)}"

    def subject(self, parameter: str, name: str, part: Excerpt) -> Subject:
        """Return what ``name`` stands for; raises :class:`QueryError` at ``part``."""
        fact = self.facts.get(name)
        if fact is not None:
            return Subject("fact", name, fact.kind)
        if self.has_pointers and name.startswith("/"):
            if len(name) > LONGEST_POINTER or not _POINTER.match(name):
                message = f"{name[:60]!r} is no JSON pointer of at most {LONGEST_POINTER} characters"
                raise QueryError(
                    parameter, "invalid_pointer", f"{message} such as /motion/lambda", part.start
                )
            return Subject("pointer", name, Kind.NUMBER)
        if self.has_labels and name.startswith(LABEL):
            key = name.removeprefix(LABEL)
            if not LABEL_KEY.match(key):
                message = f"{key[:60]!r} is no key of a label; accepted are {LABEL_KEYS}"
                raise QueryError(parameter, "invalid_label", message, part.start)
            return Subject("label", key, Kind.TEXT)
        near = get_close_matches(name[:60], self.facts, n=1)
        guess = f"did you mean {near[0]!r}? " if near else ""
        message = f"there is no column {name[:60]!r} here; {guess}{self.accepted()}"
        raise QueryError(parameter, "unknown_column", message, part.start)
