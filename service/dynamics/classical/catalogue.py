"""The cases by their names, in the order of their years."""

from collections.abc import Mapping
from types import MappingProxyType

from service.dynamics.classical.cases import (
    bobylev_steklov,
    chaplygin,
    dokshevich_1965,
    elliptic_x_minus_k_over_x,
    goriatchev,
    grioli,
    hess,
    konosevich_pozdnyakovich,
    kowalewski,
    staude,
    steklov,
)
from service.dynamics.classical.protocol import ClassicalCase

_MODULES = (
    hess,
    staude,
    bobylev_steklov,
    goriatchev,
    steklov,
    chaplygin,
    kowalewski,
    grioli,
    dokshevich_1965,
    konosevich_pozdnyakovich,
    elliptic_x_minus_k_over_x,
)
CASES: Mapping[str, ClassicalCase] = MappingProxyType({module.CASE.name: module.CASE for module in _MODULES})
