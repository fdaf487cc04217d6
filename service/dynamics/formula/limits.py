"""Limits of a formula's size, each checked before the work that it bounds."""

from service.dynamics.formula.errors import FormulaLimitError

MAX_CHARACTERS = 4000
"""Length of the text."""
MAX_TOKENS = 2500
"""Numbers, names, operators and parentheses: room for a sum of 1000 terms."""
MAX_DEPTH = 60
"""Parentheses, calls, signs and exponents inside each other. Flat sums and products are free."""
MAX_NODES = 10_000
"""Nodes of any tree, also of one built by a family or grown by binding."""
MAX_NAME = 60
"""Characters of one name."""
MAX_EXPONENT = 1000
"""Absolute value of a constant exponent."""
MAX_BITS = 4096
"""Bits of the numerator or the denominator of a folded constant; literals have fewer
(:data:`service.dynamics.exact.MAX_DIGITS` and ``MAX_EXPONENT``)."""


def require(count: int, limit: int, what: str, *, position: int | None = None) -> None:
    """Raise FormulaLimitError if ``count`` exceeds ``limit``; ``what`` is a plural noun."""
    if count > limit:
        raise FormulaLimitError(f"{count} {what}; at most {limit} are accepted", position=position)
