"""The Python client as a page, made from its signatures and docstrings."""

import inspect
import re
from collections.abc import Callable, Iterator
from types import FunctionType

import polhode as ph
from polhode.atlases import Atlas, Band, Change, Part
from polhode.clients import Operations
from polhode.evaluation import FunctionOfTime
from polhode.jobs import Job
from polhode.listings import Listing
from polhode.lists import JobList
from polhode.motions import Motion
from polhode.studies import Answer, Hit, Judgement, Numbers
from polhode.sweeps import Point, Sweep
from polhode.transport.terms import operation

FUNCTIONS = (ph.connect, ph.connect_async, ph.local, ph.problem, ph.linspace, ph.logspace, ph.uniform)
CLASSES = {
    "c, of ph.connect() and ph.local()": Operations,
    "Motion": Motion,
    "Samples": ph.Samples,
    "Quantity": ph.Quantity,
    "FunctionOfTime": FunctionOfTime,
    "Judgement": Judgement,
    "Job": Job,
    "JobList": JobList,
    "Sweep": Sweep,
    "Point": Point,
    "Atlas": Atlas,
    "Part": Part,
    "Band": Band,
    "Change": Change,
    "Answer": Answer,
    "Numbers": Numbers,
    "Hit": Hit,
    "Listing": Listing,
}
ERRORS = sorted(
    (each for each in vars(ph).values() if inspect.isclass(each) and issubclass(each, Exception)),
    key=lambda each: (len(each.__mro__), each.__name__),
)
SECTION = re.compile(r"^([A-Z]\w+)\n-+\n", re.MULTILINE)
CROSS_REFERENCE = re.compile(r":\w+:`~?(?:[\w.]*\.)?(\w+)`")


def client_page() -> str:
    """Return the page of all that the client has for its users."""
    lines = [
        "# The Python client, by name",
        "",
        "Made from the docstrings. How it is meant to be used: [the Python client](../client.md). In an "
        "event loop, with `ph.connect_async()`, methods are awaited.",
        "",
        "## Functions",
        "",
    ]
    for function in FUNCTIONS:
        lines += _entry(f"ph.{function.__name__}", function)
    for title, kind in CLASSES.items():
        lines += [f"## {title}", "", *_text(kind.__doc__ or "")]
        for name in dict.fromkeys(name for base in kind.__mro__ for name in vars(base)):
            member = inspect.getattr_static(kind, name)
            if not name.startswith("_") and isinstance(member, property | FunctionType | operation):
                lines += _entry(name, member)
    lines += ["## Errors", ""]
    for error in ERRORS:
        lines += [f"### ph.{error.__name__}", "", *_text(error.__doc__ or "")]
    return "\n".join(lines)


def _entry(name: str, member: object) -> Iterator[str]:
    if isinstance(member, property):
        yield from (f"### {name}", "")
    else:
        function = member.call if isinstance(member, operation) else member
        assert callable(function)
        yield from (f"### {name}()", "", "```python", f"{name}({', '.join(_arguments(function))})", "```", "")
    yield from _text(member.__doc__ or "")


def _arguments(function: Callable[..., object]) -> Iterator[str]:
    """Yield the arguments as they are written, without their types: the text tells them where they matter."""
    parameters = [each for name, each in inspect.signature(function).parameters.items() if name != "self"]
    is_by_name = False
    for one in parameters:
        if one.kind is one.KEYWORD_ONLY and not is_by_name:
            is_by_name = True
            yield "*"
        if one.kind is one.VAR_POSITIONAL:
            is_by_name = True
        stars = "*" if one.kind is one.VAR_POSITIONAL else "**" if one.kind is one.VAR_KEYWORD else ""
        default = "" if one.default is one.empty else f"={one.default!r}"
        yield f"{stars}{one.name}{default}"


def _text(docstring: str) -> Iterator[str]:
    """Yield a docstring as Markdown; its sections become lists of names with their meanings."""
    text = CROSS_REFERENCE.sub(r"`\1`", inspect.cleandoc(docstring)).replace("``", "`")
    head, *sections = SECTION.split(text)
    yield from (head.strip(), "")
    for title, body in zip(sections[::2], sections[1::2], strict=True):
        yield from (f"**{title}**", "")
        for line in body.strip().splitlines():
            if line.startswith(" "):
                yield f"    {line.strip()}"
            elif line:
                yield f"- `{line.strip()}`:"
        yield ""
