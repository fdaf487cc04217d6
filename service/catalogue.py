"""The families of potentials, one for each ``type`` of a problem document; named and classical cases."""

from service.dynamics.classical.bodies import CASES
from service.dynamics.classical.protocol import ClassicalCase
from service.schemas.reading.documents import Document
from service.schemas.replies.installation import CaseOut, ClassicalOut, FamilyOut

YEHIA = (
    "H. M. Yehia, New solvable problems in the dynamics of a rigid body "
    "about a fixed point in a potential field"
)


def planar_example(
    body: Document,
    potential: Document,
    motion: Document,
    time: Document | None = None,
) -> Document:
    """Return a problem document: a planar motion, by default over two periods."""
    return {
        "body": body,
        "potential": potential,
        "motion": {"type": "planar", **motion},
        "time": time or {"periods": 2, "samples": 401},
        "outputs": ["gamma", "omega", "invariants"],
    }


def cases() -> list[CaseOut]:
    """Return the cases, from the classical one to its generalisations and back to their special bodies."""
    return [
        CaseOut(
            name="bobylev-steklov",
            title="The solution of Bobylev and Steklov",
            family="gravity",
            special="A = 2C, V = a g1: p is constant, every motion passes the poles, and the motion of the "
            "body is elliptic.",
            source="D. K. Bobylev and V. A. Steklov, 1896",
            example=planar_example({"A": 2, "B": "3/2", "C": 1}, {"type": "gravity", "a": -1}, {"nu": 1}),
        ),
        CaseOut(
            name="generalised-bobylev-steklov",
            title="Bobylev and Steklov for any moments",
            family="homogeneous",
            special="V = a |g1|^(2(A-C)/A): p is constant, of absolute value (λ/A) sqrt(-2 a C), "
            "and the energy is -a λ² C/A.",
            source=f"{YEHIA}: B_0 alone",
            example=planar_example(
                {"A": 3, "B": "5/2", "C": 1}, {"type": "homogeneous", "B": [-1]}, {"lambda": 1}
            ),
        ),
        CaseOut(
            name="elliptic",
            title="Three terms solved by elliptic functions",
            family="rational",
            special="A = 2C, V = a1 g1 + c1 (g1² - g2²) + b1/g3²: of the rational potentials, those whose "
            "motions are elliptic functions of time, for every B.",
            source=YEHIA,
            example=planar_example(
                {"A": 2, "B": "3/2", "C": 1},
                {"type": "rational", "a": [-1], "b": ["1/50"], "c": ["6/5"]},
                {"nu": 1},
            ),
        ),
        CaseOut(
            name="goriachev",
            title="The case of Goriachev",
            family="rational",
            special="The elliptic potential of a body with A = B = 2C: integrable on the zero level of the "
            "areas integral, by a further integral of degree 4 in p and q.",
            source="D. N. Goriachev, 1916",
            example=planar_example(
                {"A": 2, "B": 2, "C": 1},
                {"type": "rational", "a": [-1], "b": ["1/20"], "c": ["1/2"]},
                {"nu": 1},
            ),
        ),
        CaseOut(
            name="chaplygin",
            title="The case of Chaplygin",
            family="rational",
            special="A = B = 2C and b1 = 0: integrable as that of Goriachev. The paper takes it for motion "
            "by inertia in a fluid; but a1 g1 is no inertia, and with a1 = 0 too the planar motions are "
            "asymptotic to the pole.",
            source="S. A. Chaplygin, 1903",
            example=planar_example(
                {"A": 2, "B": 2, "C": 1}, {"type": "rational", "a": [-1], "c": ["1/2"]}, {"nu": 1}
            ),
        ),
        CaseOut(
            name="kovalevskaya",
            title="The top of Kovalevskaya",
            family="gravity",
            special="A = B = 2C, V = a g1: integrable on every level of the areas integral, "
            "by a further integral of degree 4 in p and q.",
            source="S. Kovalevskaya, 1889",
            example=planar_example({"A": 2, "B": 2, "C": 1}, {"type": "gravity", "a": -1}, {"nu": 1}),
        ),
        CaseOut(
            name="logarithmic",
            title="A logarithm where the series has a gap",
            family="homogeneous",
            special="A = 3C, where B_2 has no value: the solution of degree 4 has "
            "(g1² + g3²) (3 g1² + g3²) log(g1²/(g1² + g3²)) instead.",
            source=f"{YEHIA}: for F = w, at moments that its series leaves out",
            example=planar_example(
                {"A": 3, "B": "5/2", "C": 1},
                {"type": "homogeneous", "A": ["-3/2", 0, 3], "log": [0, 0, "-1/10"]},
                {"lambda": "4/5", "window": 1},
            ),
        ),
    ]


def classical() -> list[ClassicalOut]:
    """Return the cases in the order of the table of the paper, and the one whose text was not obtained."""
    return [*(_row(case) for case in CASES.values()), _not_obtained()]


def example_of(case: ClassicalCase) -> Document:
    """Return a problem document: two periods, or ten units of time where the motion does not close."""
    given: Document = dict(case.example)
    body = {name: given.pop(name) for name in "ABC" if name in given}
    centre = {name: given.pop(name) for name in "abc" if name in given}
    potential: Document = {"type": "gravity", **centre}
    motion: Document = {"type": "classical", "case": case.name, **given}
    time: Document = {"periods": 2} if case.form == "loop" else {"stop": 10}
    return {
        "body": body,
        "potential": potential,
        "motion": motion,
        "time": {**time, "samples": 401},
        "outputs": ["gamma", "omega", "invariants"],
    }


def _row(case: ClassicalCase) -> ClassicalOut:
    about = case.about
    return ClassicalOut(
        case=case.name,
        title=about.title,
        author=about.author,
        year=about.year,
        conditions=list(about.conditions),
        real=about.real,
        parameters=case.fields,
        relations=list(about.relations),
        functions=about.functions,
        periodic=case.form == "loop",
        stability=about.stability,
        source=about.source,
        example=example_of(case),
    )


def _not_obtained() -> ClassicalOut:
    return ClassicalOut(
        case="dokshevich_1970",
        title="A new particular solution of the equations of motion of a gyroscope having a fixed point",
        author="A. I. Dokshevich",
        year=1970,
        conditions=[],
        real="not known: no text of the paper was obtained",
        parameters={},
        relations=[],
        functions="not known; elliptic_x_minus_k_over_x may be this case, which nobody has checked",
        periodic=None,
        stability="not known",
        source="not_obtained",
        example=None,
    )


def families() -> list[FamilyOut]:
    """Return the families, the most general formula first."""
    return [_expression(), _gravity(), _rational(), _homogeneous(), _general()]


def _expression() -> FamilyOut:
    return FamilyOut(
        type="expression",
        title="Any potential, by its formula",
        potential="expression",
        conditions=["Planar motions need the compatibility equation: POST /v1/validations decides it."],
        parameters={
            "expression": "a formula in g1, g2, g3, the parameters and A, B, C",
            "parameters": "the named constants of the formula, exact",
        },
        source=YEHIA,
        example=planar_example(
            {"A": 2, "B": "3/2", "C": 1},
            {
                "type": "expression",
                "expression": "a1*g1 + b1/g3^2 + c1*(g1^2 - g2^2)",
                "parameters": {"a1": -1, "b1": "1/50", "c1": "6/5"},
            },
            {"lambda": 1},
            {"stop": 10, "samples": 101},
        ),
    )


def _gravity() -> FamilyOut:
    return FamilyOut(
        type="gravity",
        title="A heavy body",
        potential="a*g1 + b*g2 + c*g3",
        conditions=[
            "Planar motions: A = 2*C and b = c = 0 (Bobylev and Steklov), or C = 2*A and a = b = 0.",
        ],
        parameters={
            "a": "weight times the first coordinate of the centre of mass",
            "b": "weight times the second coordinate",
            "c": "weight times the third coordinate",
        },
        source="D. K. Bobylev and V. A. Steklov, 1896",
        example=planar_example(
            {"A": 2, "B": "3/2", "C": 1},
            {"type": "gravity", "a": -1},
            {"nu": 1},
            {"periods": 1, "samples": 201},
        ),
    )


def _rational() -> FamilyOut:
    return FamilyOut(
        type="rational",
        title="Rational potentials",
        potential="a1*g1 + b1/g3^2 + c1*(g1^2 - g2^2) + c2*g2^2*(2*g1^2 + g3^2) + ...",
        conditions=["A = 2*C"],
        parameters={
            "a": "coefficients a1, a2, ... of the terms odd in g1",
            "b": "coefficients b1, b2, ... of the terms singular at g3 = 0",
            "c": "c1 of g1^2 - g2^2; ck of g2^(2*k-2)*(2*g1^2 + g3^2) for k >= 2",
        },
        source=YEHIA,
        example=planar_example(
            {"A": 2, "B": "17/10", "C": 1},
            {
                "type": "rational",
                "a": [-2, "1/20", "1/200"],
                "b": ["1/50", "1/500", "1/4000"],
                "c": ["1/5", "1/10"],
            },
            {"nu": 1},
        ),
    )


def _homogeneous() -> FamilyOut:
    return FamilyOut(
        type="homogeneous",
        title="Homogeneous potentials of any moments",
        potential="(A*g1^2 + C*g3^2)*(A0 + A1*g2 + ...) + B0*abs(g1)^(2*(A-C)/A) + ..."
        " + C0*abs(g3)^(-2*(A-C)/C) + ...",
        conditions=[
            "A != C; alpha = A/C",
            "B_n has no value for alpha = (n+1)/m with m = 1, ..., n-1, and is a multiple of"
            " A*g1^2 + C*g3^2 for alpha = (n+1)/n",
            "C_n has no value for alpha = m/(n+1) with m = 1, ..., n-1, and is a multiple of"
            " A*g1^2 + C*g3^2 for alpha = n/(n+1)",
            "log_n is there instead: for alpha or 1/alpha = (n+1)/m with m = 1, ..., n",
        ],
        parameters={
            "A": "coefficients A0, A1, ... of g2^n*(A*g1^2 + C*g3^2)",
            "B": "B0, B1, ... of abs(g1)^(2*(alpha-1)*(n+1)/alpha) times"
            " 2F1(-n, -(alpha-1)*(n+1)/alpha; 1-n+(n+1)/alpha; 1+g3^2/g1^2)",
            "C": "C0, C1, ... of g1^(2*n)*abs(g3)^(-2*(alpha*n+alpha-1)) times"
            " 2F1(2, -n; alpha+1+(alpha-1)*n; 1+g3^2/g1^2)",
            "log": "coefficients of the solutions with log(g1^2/(g1^2+g3^2)), log(g3^2/(g1^2+g3^2)) if A < C,"
            " at the index n of the term they replace",
        },
        source=YEHIA,
        example=planar_example(
            {"A": "17/10", "B": 2, "C": 1},
            {"type": "homogeneous", "A": [0, "1/4"], "B": [-1], "C": ["1/50"]},
            {"lambda": "6/5"},
        ),
    )


def _general() -> FamilyOut:
    return FamilyOut(
        type="general",
        title="The general solution",
        potential="V1[F] + (A*g1^2 + C*g3^2)*G(g2)",
        conditions=[
            "A != C",
            "The motions take place on abs(g3) = lambda*abs(g1)^(C/A) with energy -F(w),"
            " w = abs(A-C)^(A/C-1)*lambda^(2*A/C)",
        ],
        parameters={
            "F": "a formula in w > 0, the parameters and A, B, C; or four, F_pp, F_mp, F_pm and F_mm,"
            " each for one pair of signs of g1 and g3",
            "G": "a formula in g2, 0 if left out; or G_pp, G_mp, G_pm and G_mm",
            "parameters": "the named constants of the formulas, exact",
            "reference_angle": "the angle atan2(abs(g3), abs(g1)) at which V1 vanishes, between 0 and pi/2;"
            " another one changes V by a multiple of A*g1^2 + C*g3^2 that is even in g2",
        },
        source=YEHIA,
        example=planar_example(
            {"A": "17/10", "B": "7/5", "C": 1},
            {
                "type": "general",
                "F": "k*w",
                "G": "3*g2^2 + 3/10*g2 - 9/5",
                "parameters": {"k": 1},
            },
            {"lambda": "11/10"},
        ),
    )
