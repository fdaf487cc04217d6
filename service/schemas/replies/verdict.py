"""The answer of POST /v1/validations."""

from typing import Literal

from pydantic import Field

from service.schemas.replies.response_model import QuadrantOut, ResponseModel


class FormulaFormatsOut(ResponseModel):
    """One equation in several formats."""

    text: str = Field(description="In the grammar of formulas, but for the time, `cn` and `K(m)`.")
    latex: str | None = Field(description="For mathematics mode; null if it was not asked for.")
    mathml: str | None = Field(
        description="Presentation MathML: one `math` element; null if it was not asked for."
    )


class FormulaOut(ResponseModel):
    """An equation that can be shown as it is."""

    name: Literal[
        "V",
        "h",
        "F",
        "G",
        "nearest",
        "curve",
        "p_squared",
        "speed_squared",
        "time",
        "g1",
        "cn",
        "x1",
        "x2",
        "k",
        "Omega",
        "kappa",
        "m",
        "period",
    ] = Field(
        description="What it is about. `curve`: g3² on the curve. `p_squared`, `speed_squared`, `time`: p²,"
        " (dg1/dt)² and the time as an integral over g1, on the curve. `g1` and all after it: the motion in"
        " elliptic functions, if it has them, of the time since |g1| was smallest."
    )
    formats: FormulaFormatsOut = Field(description="The equation, in every format that was asked for.")
    simplified: bool = Field(
        description="`formats` show the shortest form that was found and proved to be the same function."
        " False: there was no time, or nothing to simplify; the formula is shown as it stands."
    )
    named: bool = Field(
        description="It has the names of the client's parameters in it, and holds for all their values."
    )
    at: list[str] = Field(
        description="JSON pointers to the fields of this answer that it is another form of."
    )
    quadrants: list[QuadrantOut] = Field(description="Signs of g1 and g3 for which it holds.")
    g2_sign: Literal[1, -1] | None = Field(description="Sign of g2 for which it holds; null: for both.")
    window: int | None = Field(description="Number of the window whose motion it is; null: of none.")


class KnownCaseOut(ResponseModel):
    """A case of the heavy body that has a name."""

    name: str = Field(
        description="`euler`, `lagrange`, `kovalevskaya`, `goriachev_chaplygin` (integrable, the last on the"
        " zero level of the areas), or `bobylev_steklov` (the motions with q = 0)."
    )
    source: str = Field(description="Who found it, and when.")


class RatiosOut(ResponseModel):
    """The ratios A/C for which the potential would be admissible, all of them, exactly."""

    all: bool = Field(description="It is for every ratio but 1.")
    ratios: list[str] = Field(description="Else those that are ratios of integers; often none.")
    others: list[str] = Field(
        description="Polynomials in A, for the C that was sent, whose positive roots are further values of A."
    )


class BallOut(ResponseModel):
    """mid ± rad, in decimals: the exact number is certainly inside."""

    mid: str = Field(description="Middle, a decimal.")
    rad: str = Field(description="Radius, a decimal ≥ 0.")


class CounterexampleOut(ResponseModel):
    """A point of the sphere where a quantity that vanishes for admissible potentials is proved not to."""

    kind: Literal["residual", "jump_of_potential", "jump_of_energy"] = Field(
        description="`residual`: that of the compatibility equation is not 0 at the point. Else curves cross"
        " a line there on which an absolute value has a kink or an even root is 0, and the potential, or the"
        " energy of the motion with q = 0, is not the same on both sides."
    )
    g: tuple[str, str, str] = Field(description="g1, g2, g3: exact where `radius` is null, else decimals.")
    radius: str | None = Field(
        description="Error of each of `g`, for a point of a kink or of a motion's curve."
    )
    residual: BallOut = Field(
        description="The residual at that point, or by how much the potential or the energy jumps; without 0."
    )


class EvidenceOut(ResponseModel):
    """Zero could not be excluded anywhere, and no proof was found."""

    points: int = Field(description="Number of points of the sphere that were tried.")
    bits: int = Field(description="Precision of the ball arithmetic.")
    largest_enclosure: str = Field(
        description="Largest absolute value that the residual may have at one of them, a decimal."
    )
    doubt: str = Field(description="The part that is not proved, as the end of a sentence.")


EndOut = Literal["pole", "rest", "equator", "equilibrium", "standstill", "edge", "collision"]


class MotionWindowOut(ResponseModel):
    """A stretch of the curve on which a motion takes place."""

    window: int = Field(description="Its number, for the motion's `window`.")
    kind: Literal["periodic", "separatrix", "equilibrium", "standstill", "collision", "pole", "edge"] = Field(
        description="`periodic`, or what keeps the motion from coming back: it tends to an equilibrium"
        " (`separatrix`), stays in one (`equilibrium`), comes to rest after a finite time at a point"
        " that it may leave at any later one (`standstill`), reaches a singularity of the potential"
        " (`collision`), tends to the `pole`, or meets the `edge` of the potential's domain."
    )
    ends: tuple[EndOut, EndOut] = Field(
        description="Where |g1| is smallest, where it is largest. At a `collision` p² grows without bound,"
        " and the motion ends after a finite time; one at a pole of the sphere is named `pole`."
    )
    g1: tuple[float, float] = Field(description="g1, with its sign, at the two ends.")
    g2: tuple[float, float] = Field(description="Smallest and largest g2 of the northern arc.")


class FunctionOut(ResponseModel):
    """A function of one variable: a formula, or values where there is none."""

    formula: str | None = Field(description="In the one variable, with all numbers put in.")
    named: str | None = Field(
        description="The same with the names of the parameters (for coefficients in lists a1, A0, ...);"
        " true for all their values. Null if there are none, or if it is true for those values only."
    )
    numeric: bool = Field(description="There is no formula, and `points` has values.")
    points: list[tuple[float, float]] = Field(
        description="[argument, value], the values rounded to doubles; empty where there is a formula."
    )
    error: float | None = Field(description="Largest absolute error of a value; null where there are none.")


class EnergyQuadrantsOut(ResponseModel):
    """h by the signs of g1 and g3, p for plus, m for minus; null where the potential has no value."""

    pp: FunctionOut | None = Field(description="g1 > 0, g3 > 0.")
    mp: FunctionOut | None = Field(description="g1 < 0, g3 > 0.")
    pm: FunctionOut | None = Field(description="g1 > 0, g3 < 0.")
    mm: FunctionOut | None = Field(description="g1 < 0, g3 < 0.")


class EnergyFormulaOut(ResponseModel):
    """The energy of the motions as a function of the curve."""

    h: str | None = Field(
        description="The formula, if one holds whatever the signs of g1 and g3; else null, see `quadrants`."
    )
    h_named: str | None = Field(description="h with the names of the parameters, as `named` of a function.")
    variable: Literal["lambda", "nu"] = Field(description="The variable of h: nu where A = 2C, else lambda.")
    quadrants: EnergyQuadrantsOut = Field(description="h by the signs of g1 and g3.")


class TermsOut(ResponseModel):
    """V = constant + (A g1² + C g3²) Σ A_n g2^n + Σ B_n-, C_n- and log_n-terms, n from 0; exact."""

    constant: str = Field(description="The constant.")
    A: list[str] = Field(description="A_0, A_1, ...")
    B: list[str] = Field(description="B_0, B_1, ...")
    C: list[str] = Field(description="C_0, C_1, ...")
    log: list[str] = Field(description="Coefficients of the logarithmic terms, from n = 0.")


class QuadrantValuesOut(ResponseModel):
    """F and G at the points that were sent."""

    F: list[tuple[float, float | None, float | None]] = Field(
        description="[w, value, error]; nulls where F has no value."
    )
    G: list[tuple[float, float | None, float | None]] = Field(
        description="[g2, value, error]; nulls where G has no value."
    )


class PartsOut(ResponseModel):
    """F and G where g1 and g3 have certain signs."""

    F: FunctionOut = Field(description="In w.")
    G: FunctionOut = Field(description="In g2.")
    terms: TermsOut | None = Field(
        description="Coefficients, if V is a finite sum of the known terms (on |g1| and |g3|)."
    )


class PartsQuadrantsOut(ResponseModel):
    """F and G by the signs of g1 and g3, p for plus, m for minus; null where the potential has no value."""

    pp: PartsOut | None = Field(description="g1 > 0, g3 > 0.")
    mp: PartsOut | None = Field(description="g1 < 0, g3 > 0.")
    pm: PartsOut | None = Field(description="g1 > 0, g3 < 0.")
    mm: PartsOut | None = Field(description="g1 < 0, g3 < 0.")


class DecompositionOut(ResponseModel):
    """V = V1[F] + (A g1² + C g3²) G(g2).

    `quadrants` always has everything. The fields beside it are what all
    quadrants have in common, null where they differ or there is no formula.
    """

    F: str | None = Field(description="Formula in w, if one holds on all quadrants.")
    F_named: str | None = Field(description="F with the names of the parameters, as `named` of a function.")
    G: str | None = Field(description="Formula in g2, if one holds on all quadrants.")
    G_named: str | None = Field(description="G with the names of the parameters.")
    reference_angle: str = Field(description="atan2(|g3|, |g1|) where V1 = 0.")
    terms: TermsOut | None = Field(description="Coefficients, if they are the same on all quadrants.")
    quadrants: PartsQuadrantsOut = Field(description="F, G and terms by the signs of g1 and g3.")
    values: dict[QuadrantOut, QuadrantValuesOut] | None = Field(description="At the points that were sent.")


class NearestSpaceOut(ResponseModel):
    """The set searched for the nearest polynomial: a linear space, found by exact linear algebra."""

    description: str = Field(description="Which polynomials, for people.")
    dimension: int = Field(description="How many of them a basis has, as functions on the sphere.")


class NearestDistanceOut(ResponseModel):
    """Distance of the nearest admissible polynomial up to a degree."""

    degree: int = Field(description="Largest degree that the polynomial may have.")
    relative_squared_distance: str = Field(description="Mean of (V - nearest)² over that of V², exact.")


class NearestOut(ResponseModel):
    """The admissible polynomial nearest to one that is not, in the mean square over the sphere."""

    expression: str = Field(description="The polynomial, as a formula in g1, g2, g3 with exact numbers.")
    expression_named: str | None = Field(
        description="With the names of the parameters, true for all their values; null if there is none."
    )
    relative_squared_distance: str = Field(description="Mean of (V - nearest)² over that of V², exact.")
    degree: int = Field(description="No admissible polynomial up to this degree is nearer.")
    space: NearestSpaceOut = Field(
        description="The searched space: all admissible polynomials up to `degree`."
    )
    by_degree: list[NearestDistanceOut] = Field(
        description="The same distance if only polynomials up to a lower degree are searched: for 0, 1, ...,"
        " `degree`; it never grows."
    )


class NoticeOut(ResponseModel):
    """A warning about the potential, which is valid."""

    code: str = Field(description="Stable code for programs.")
    message: str = Field(description="Sentence for people.")
    pointer: str = Field(description="JSON pointer to the field it is about.")


class TierPlanOut(ResponseModel):
    """Expected time and error of a tier on the problem that was sent, or why it cannot solve it."""

    tier: Literal["draft", "standard", "high", "certified"] = Field(description="The tier.")
    tolerance: float = Field(description="What it promises.")
    expected_seconds: float | None = Field(
        description="By the slowest comparable problem of the accuracy table; null if there is none, as where"
        " `remarks` tell that the motion is unusual (`pole_passage`, `near_rest`, `narrow_feature`,"
        " `infinite_slope`). A tier saves time only where this is less than that of the next better one."
    )
    expected_error: float | None = Field(
        description="The largest error that a comparable solution claimed; for `certified` a proven radius."
    )
    unavailable: str | None = Field(
        description="Why the problem has no solution at this tier, or comparable ones had none; else null."
    )


class PlanOut(ResponseModel):
    """The plan of a job for the problem that was sent."""

    method: Literal["quadrature", "integration", "both"] = Field(
        description="The method; for `auto` the chosen one."
    )
    tier: Literal["draft", "standard", "high", "certified"] = Field(
        description="The tier that was asked for, that keeps the tolerance, or that is chosen for the budget."
    )
    tolerance: float = Field(
        description="Largest error of any variable that is allowed: absolute; of a tier relative to the size"
        " of the variable's group where that is above 1; always relative to it if that was asked."
    )
    samples: int = Field(description="Times at which the solution is stored.")
    window: MotionWindowOut | None = Field(description="Of a planar motion.")
    remarks: list[NoticeOut] = Field(
        description="What makes a job slower than the table says, less accurate, or likely to be refused:"
        " `integral`, `pole_passage`, `near_rest`, `narrow_feature`, `infinite_slope`, and how it ends:"
        " `collision`, `pole`, `separatrix`. Empty where nothing is known."
    )
    expected_seconds: float | None = Field(description="That of the tier, among `tiers`.")
    tiers: list[TierPlanOut] = Field(description="The same problem at each tier, from draft to certified.")
    solution: str | None = Field(
        description="Id of a stored solution of this problem: a job would return it at once, `reused`."
    )


class StretchOut(ResponseModel):
    """All values between two ends, each of which is somewhere in its ball."""

    from_: BallOut | None = Field(alias="from", description="Null: from 0, or from -∞ where nu < 0.")
    to: BallOut | None = Field(description="Null: to ∞, or to 0 where nu < 0.")


class ExistenceOut(ResponseModel):
    """The λ for which motions with the given signs exist, proved except where it is undecided."""

    lambda_: list[StretchOut] | None = Field(
        alias="lambda", description="For all of these λ there are motions; null if nu was sent."
    )
    nu: list[StretchOut] | None = Field(description="The same in nu; null if lambda was sent.")
    undecided: list[StretchOut] = Field(
        description="Undecided values. For values in neither list there is no motion."
    )


class NearCaseOut(ResponseModel):
    """A classical case that the body has, and a state."""

    case: str = Field(description="As in the catalogue of `GET /v1/families`.")
    distance: float | None = Field(
        description="From the state of the case to which Newton's least steps onto its relations lead, in the"
        " six variables: never less than the true distance. Null if they lead nowhere."
    )
    is_on: bool = Field(description="The distance is at most 1e-12 (of the state, if that is longer than 1).")
    relations: dict[str, float | None] = Field(
        description="What each relation leaves at the state; null where it has no value."
    )


class IntegrableOut(ResponseModel):
    """An integrable case."""

    case: Literal["euler", "lagrange", "kovalevskaya", "goriachev_chaplygin"] = Field(description="The case.")
    holds: bool = Field(description="Whether all its conditions hold.")
    residuals: dict[str, float] = Field(description="What is left of each condition, relative.")


class ClassificationOut(ResponseModel):
    """The classical and integrable cases on which a state lies, and the nearest one."""

    on: list[str] = Field(description="Those on which it lies, classical ones first.")
    nearest: NearCaseOut | None = Field(description="The nearest classical case of the body.")
    cases: list[NearCaseOut] = Field(
        description="Every classical case whose condition the body satisfies, the nearest first."
    )
    integrable: list[IntegrableOut] = Field(description="The integrable cases.")


class VerdictOut(ResponseModel):
    """Whether a potential admits the planar motions, and how that is known."""

    verdict: Literal["admissible", "inadmissible", "undecided"] | None = Field(
        description="`admissible` and `inadmissible` are proved; `undecided` is neither. Null for a whole"
        " problem from a state: its job needs no verdict."
    )
    proof: Literal["symbolic", "counterexample", "numeric"] | None = Field(
        description="`symbolic`: the compatibility equation holds identically; `counterexample`: it fails at"
        " the point that is given; `numeric`: no such point was found, which proves nothing. Null where the"
        " verdict is."
    )
    energy: EnergyFormulaOut | None = Field(
        description="Of an admissible potential; null if it is not known."
    )
    counterexample: CounterexampleOut | None = Field(description="With proof `counterexample`.")
    evidence: EvidenceOut | None = Field(description="With proof `numeric`.")
    decomposition: DecompositionOut | None = Field(description="Of an admissible potential.")
    nearest: NearestOut | None = Field(description="Of a polynomial that is not admissible.")
    ratios: RatiosOut | None = Field(description="Of a polynomial that is not admissible.")
    motions: list[MotionWindowOut] | None = Field(
        description="Every window of the motion that was sent; null if none was, or if there are no motions."
    )
    plan: PlanOut | None = Field(
        description="Of a whole problem (a motion and times were sent): how its job would solve it."
    )
    existence: ExistenceOut | None = Field(
        description="The λ for which motions exist, if there are none for the one that was sent;"
        " else null, as for a potential that has no formula.",
    )
    formulas: list[FormulaOut] | None = Field(
        description="With `?formulas=`: the formulas of this answer, ready to be shown; else null."
    )
    classical: ClassificationOut | None = Field(
        description="Of a state (a motion of the type state, with all moments) in a potential of the type"
        " gravity: the classical and integrable cases it lies on, or is near; else null."
    )
    known_cases: list[KnownCaseOut] = Field(
        description="Those that the body and the field are, by exact conditions, however V is written."
    )
    warnings: list[NoticeOut] = Field(description="Warnings about the potential; often empty.")
