"""The named cases of the literature, each as a member of a family."""

from service.catalogue.documents import YEHIA, planar_example
from service.schemas.replies.installation import CaseOut


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
