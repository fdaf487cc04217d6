"""Escapes clients' text for logs and terminals, so that it forges no line and controls no terminal."""


def one_line(text: str) -> str:
    """Return ``text`` with every character escaped that is neither printable nor a space.

    Text from clients may be part of it: line breaks would forge log lines, escape
    sequences control a terminal, and direction marks change the order in which
    text is shown. "Printable" is meant as Unicode defines it.
    """
    if text.isprintable():
        return text
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode("ascii")
        for character in text
    )


def printable(text: str) -> str:
    """Escape like :func:`one_line` but keep line breaks: for text whose lines this program wrote."""
    return "\n".join(map(one_line, text.split("\n")))
