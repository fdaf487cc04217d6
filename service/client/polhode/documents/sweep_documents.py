"""Documents of sweeps, made from a problem and the values of its axes."""

from collections.abc import Mapping, Sequence

from polhode.documents.problems import Document, Given, changed, pointer_of, problem, read
from polhode.documents.spans import axis_section
from polhode.errors import WrongArgumentError

DEFAULT_KEEP = ("period", "energy", "error")


def sweep_document(
    base: Given, axes: Mapping[str, object], keep: Sequence[str], combine: str, *, series: bool
) -> Document:
    """Return the document of a sweep.

    Raises
    ------
    WrongArgumentError
        An axis is none, or has the name of no number of the base.
    """
    whole = read(base)
    if "base" in whole:
        if axes:
            raise WrongArgumentError("the document is a whole sweep; axes are accepted with a single problem")
        return whole
    start = problem(whole)
    sections = []
    for name, values in axes.items():
        pointer = pointer_of(start, name)
        start = _with_first(start, pointer, axis_section(values))
        sections.append({"pointer": pointer, **axis_section(values)})
    return {"base": start, "axes": sections, "combine": combine, "keep": list(keep), "series": series}


def _with_first(base: Document, pointer: str, section: Mapping[str, object]) -> Document:
    """Return the base with the first value of an axis: it has to be a problem before the axis varies it."""
    listed = next(value for name, value in section.items() if name != "seed")
    assert isinstance(listed, list)
    if not listed:
        raise WrongArgumentError(f"the axis of {pointer} has no values; one or more are accepted")
    if pointer in ("/motion/lambda", "/motion/nu"):
        return problem(base, **{"lam" if pointer.endswith("lambda") else "nu": listed[0]})
    return changed(base, {pointer: listed[0]})
