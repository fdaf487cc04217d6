"""Errors of a classical motion that does not exist as it was asked for."""

from service.dynamics.errors import DynamicsError


class CaseConditionError(DynamicsError):
    """The moments do not satisfy the condition of the case."""

    code = "case_condition"


class CaseMomentsError(DynamicsError):
    """Moments were left out that the case does not fix."""

    code = "case_moments"


class CaseCentreError(DynamicsError):
    """The centre of the potential is not where the case needs it."""

    code = "case_centre"


class CaseNotRealError(DynamicsError):
    """The case has no real motion for this body or these parameters."""

    code = "case_not_real"


class CaseParameterError(DynamicsError):
    """A parameter is missing, or is none of this case."""

    code = "case_parameter"


class NearSeparatrixError(DynamicsError):
    """The motion is too close to a separatrix for its quadrature."""

    code = "near_separatrix"
