"""Checks the names of parameters in clients' formulas."""

from collections.abc import Iterable

from service.dynamics.errors import DynamicsError
from service.dynamics.formula.binding import PI
from service.dynamics.formula.tokens import is_name
from service.dynamics.formula.tree import FUNCTIONS, VARIABLES

PARAMETERS_POINTER = "/potential/parameters"
MOMENTS = ("A", "B", "C")

RESERVED_NAMES = frozenset((*VARIABLES, *MOMENTS, PI, *FUNCTIONS))
"""Names that mean something already and cannot be parameters."""


class ParameterNameError(DynamicsError):
    """A parameter whose name is taken, or is not a name of the grammar."""

    code = "parameter_name"


def require_parameter_names(parameters: Iterable[str]) -> None:
    """Raise ParameterNameError, pointing at the parameter, if a name cannot be used."""
    for name in parameters:
        # A pointer spells "~" and "/" as "~0" and "~1" (RFC 6901).
        pointer = f"{PARAMETERS_POINTER}/{name.replace('~', '~0').replace('/', '~1')}"
        if name in RESERVED_NAMES:
            raise ParameterNameError(
                f"{name!r} cannot be a parameter: it has a meaning already", pointer=pointer
            )
        if not is_name(name):
            raise ParameterNameError(
                f"{name[:40]!r} is not a name: a letter or '_', then letters, digits and '_'", pointer=pointer
            )
