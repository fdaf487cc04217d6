"""The families of potentials, one for each ``type`` of a problem document."""

from service.catalogue.documents import YEHIA, planar_example
from service.schemas.replies.installation import FamilyOut


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
