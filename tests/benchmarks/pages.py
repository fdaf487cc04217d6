"""Parts of pages that a measurement writes: between two comments that name the part, all else being kept."""

from pathlib import Path

BEGIN, END = "<!-- {}: written by make bench -->\n", "<!-- end of {} -->\n"


class NoPlaceError(Exception):
    """A page has no place for a part."""


def part_of(page: str, name: str) -> str | None:
    """Return the text of a part; None if the page has no place for it."""
    _, begin, rest = page.partition(BEGIN.format(name))
    text, end, _ = rest.partition(END.format(name))
    return text if begin and end else None


def framed(name: str, text: str) -> str:
    """Return a part with its comments, as a page has it."""
    return BEGIN.format(name) + text + END.format(name)


def replaced(page: str, name: str, text: str) -> str:
    """Return the page with another text of a part.

    Raises
    ------
    NoPlaceError
        The page has no place for it.
    """
    old = part_of(page, name)
    if old is None:
        raise NoPlaceError(f"there is no place for {name}: {BEGIN.format(name)}…{END.format(name)}")
    return page.replace(framed(name, old), framed(name, text))


def write_part(path: Path, name: str, text: str) -> None:
    """Write a part into its place in a file.

    Raises
    ------
    NoPlaceError
        The file has no place for it.
    """
    path.write_text(replaced(path.read_text(encoding="utf-8"), name, text), encoding="utf-8")
