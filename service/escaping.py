"""Text of clients in logs and on terminals: it forges no line, and controls no terminal."""


def one_line(text: str) -> str:
    """Return ``text`` with everything escaped that is not printed as it is.

    What clients send may be among it: line breaks would forge lines, escape
    sequences control a terminal, and marks of direction show text in another
    order than it has. Accepted as they are: what Unicode calls printable, and
    the space.
    """
    if text.isprintable():
        return text
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode("ascii")
        for character in text
    )


def printable(text: str) -> str:
    """Return ``text`` as :func:`one_line` does, but for its line breaks: for text that is ours as a whole."""
    return "\n".join(map(one_line, text.split("\n")))
