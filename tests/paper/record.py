"""What is known about one place of the paper."""

from dataclasses import dataclass
from typing import Literal

Status = Literal["verified", "erratum", "remark"]


@dataclass(frozen=True, slots=True)
class Record:
    r"""A numbered equation, a display, a statement of the text.

    Formulas are LaTeX between dollars, without ``|``, ``\{``, ``\,``: a table of Markdown has to keep them.
    """

    place: str
    """The label in the TeX source, or where the display stands."""
    number: int | None
    """The number as typeset, if it has one."""
    printed: str
    status: Status
    correct: str
    """Empty where the printed form is verified without a condition."""
    proof: tuple[str, ...]
    """Names of test functions in this folder."""
