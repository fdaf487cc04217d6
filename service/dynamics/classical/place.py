"""Places a classical motion: the body, the order of axes, the scale, the state at time 0."""

from dataclasses import replace
from fractions import Fraction

from flint import arb, ctx

from service.dynamics.classical.bodies import Fitting, Partly, fittings
from service.dynamics.classical.errors import CaseMomentsError, CaseNotRealError
from service.dynamics.classical.hess_form import place_hess
from service.dynamics.classical.loop import BITS, loops
from service.dynamics.classical.placed import Placed, Start, ball, start_of
from service.dynamics.classical.protocol import Setting
from service.dynamics.classical.steady_form import place_steady
from service.dynamics.problem import ClassicalMotion


def place(motion: ClassicalMotion, moments: Partly, *, allow_unphysical: bool = False) -> Placed:
    """Return the motion of the body with these moments, None for those left out.

    Raises
    ------
    CaseCentreError, CaseMomentsError, CaseConditionError, UnphysicalInertiaError
        As :func:`.fittings`.
    CaseNotRealError
        The motion is not real; the message has the range in which it is.
    CaseParameterError
        A state does not satisfy the relations of its case.
    """
    refusal, found = CaseNotRealError(""), list[Placed]()
    with ctx.workprec(BITS):
        for fitting in fittings(motion, moments, allow_unphysical=allow_unphysical):
            try:
                found.append(FORMS[fitting.case.form](fitting, motion))
            except CaseNotRealError as error:
                refusal = error
    if not found:
        raise refusal
    # The same body in another order of axes is another one if moments were left out: the first order holds.
    found = [each for each in found if each.fitting.frame == found[0].fitting.frame]
    bodies = [(float(b.A), float(b.B or 0), float(b.C)) for b in (each.body for each in found)]
    if len(set(bodies)) > 1:
        told = "; ".join(f"A = {A:.15g}, B = {B:.15g}, C = {C:.15g}" for A, B, C in sorted(set(bodies)))
        more = " or the solution" if found[0].case.ratios is not None else ""
        raise CaseMomentsError(
            f"several bodies have these moments: {told}; give another moment{more}", pointer="/body"
        )
    return found[0]


def _place_loop(fitting: Fitting, motion: ClassicalMotion) -> Placed:
    case = fitting.case
    setting = _setting(fitting, motion)
    assert case.reduce is not None
    reduced = case.reduce(setting)
    is_finite = all(c.is_finite() for c in (*reduced.U, *reduced.V)) and not reduced.rate.contains(0)
    found = list(loops(reduced)) if is_finite else []
    strength = found[-1].strength() if found else arb(0)
    if not strength > 0:
        field = "energy" if "energy" in case.parameters else ""
        A, B, C = (float(moment) for moment in fitting.moments)
        raise CaseNotRealError(
            f"the case {case.name} has no real motion here (moments {A:.15g}, {B:.15g}, {C:.15g} in its "
            f"order of the axes); real is {case.about.real}",
            pointer=f"/motion/{field}" if field else "/body",
        )
    speed = (setting.strength / strength).sqrt() if case.is_scaled else arb(1)
    # Of mirror images about x = 0 any one will do: the others are its direction or its phase.
    placed = Placed(fitting, motion, _NOWHERE, reduced, found[-1], speed, strength)
    return replace(placed, start=start_of(placed.in_client_axes(found[-1].state(placed.first_angle()))))


def _setting(fitting: Fitting, motion: ClassicalMotion) -> Setting:
    A, B, C = fitting.moments
    a, _, c = fitting.frame.vector(motion.centre)
    parameters = dict[str, arb]()
    if motion.p is not None:
        axis = fitting.frame.axes[0]
        p, _, _ = fitting.frame.axial([motion.p if k == axis else Fraction(0) for k in range(3)])
        parameters["p"] = ball(p)
    if motion.energy is not None:
        parameters["energy"] = ball(motion.energy / A)
    return Setting(ball(B / A), ball(C / A), ball(a / A), ball(c / A), parameters)


_ZERO = (Fraction(0), Fraction(0), Fraction(0))
_NOWHERE = Start(_ZERO, _ZERO)
FORMS = {"loop": _place_loop, "steady": place_steady, "hess": place_hess}
