"""Lists the unions of a problem document with the class of each member."""

from pydantic import BaseModel

from service.schemas.problem.motions import (
    MOTIONS,
    EquatorStartIn,
    PointStartIn,
    RestStartIn,
)
from service.schemas.problem.potentials import MODELS
from service.schemas.problem.sections import TimeListIn, TimePeriodsIn, TimeSpanIn
from service.schemas.problem.tiers import BudgetIn, RelativeIn, TierIn, ToleranceIn

MEMBERS: dict[str, type[BaseModel]] = {
    **MODELS,
    **MOTIONS,
    "equator": EquatorStartIn,
    "rest": RestStartIn,
    "point": PointStartIn,
    "stop": TimeSpanIn,
    "periods": TimePeriodsIn,
    "times": TimeListIn,
    "tolerance": ToleranceIn,
    "relative": RelativeIn,
    "tier": TierIn,
    "budget_seconds": BudgetIn,
}
"""Classes by their tags, without the prefix of tags."""
