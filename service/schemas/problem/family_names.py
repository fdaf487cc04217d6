"""The names of the families of potentials, for those who read no potential."""

from typing import Literal

FamilyName = Literal["expression", "gravity", "rational", "homogeneous", "general"]
