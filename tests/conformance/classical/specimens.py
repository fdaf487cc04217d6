"""The documents of the cases, their worked examples, and bodies drawn at random in the real ranges."""

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from random import Random

from service.dynamics.classical.bodies import CASES
from service.dynamics.classical.placement import Placed, place
from service.schemas.problem.problem import read_problem
from service.schemas.reading.documents import InvalidProblemError

Document = dict[str, object]
NAMES = tuple(CASES)
LOOPS = tuple(name for name, case in CASES.items() if case.form == "loop")


def document(name: str, body: Document, potential: Document, motion: Document, **other: object) -> Document:
    return {
        "body": body,
        "potential": {"type": "gravity", **potential},
        "motion": {"type": "classical", "case": name, **motion},
        "time": {"stop": 10, "samples": 101},
        **other,
    }


def example(name: str, **other: object) -> Document:
    """Return the example of the catalogue as a document."""
    given = dict(CASES[name].example)
    body = {key: given.pop(key) for key in "ABC" if key in given}
    potential = {key: given.pop(key) for key in "abc" if key in given}
    return document(name, body, potential, given, **other)


def placed(statement: Document) -> Placed:
    problem = read_problem(statement)
    body = problem.body
    return place(problem.motion, (body.A, body.B, body.C), allow_unphysical=body.allow_unphysical)


@dataclass(frozen=True)
class Worked:
    """A worked example: a state on the motion, the energy, the areas integral and the period."""

    name: str
    body: Document
    potential: Document
    motion: Document
    omega: tuple[float, float, float]
    gamma: tuple[float, float, float]
    energy: float
    areas: float | None
    period: float
    span: float
    """How long the integration from this state stays on the motion to 1e-10, its instability considered."""

    @property
    def document(self) -> Document:
        return document(self.name, self.body, self.potential, self.motion)

    def __str__(self) -> str:
        return self.name + "".join(f" {value}" for value in self.motion.values())


WORKED = (
    Worked(
        "bobylev_steklov", {"A": 2, "B": "3/2", "C": 1}, {"a": 1}, {"p": "2/5", "energy": "53/200"},
        (0.4, 0.0, 0.9), (-0.3, 0.8834025130143110477, 0.36), 0.265, 0.084, 7.340179054514055, 100,
    ),
    Worked(
        "bobylev_steklov", {"A": 2, "B": "3/2", "C": 1}, {"a": 1}, {"p": "2/5", "energy": "4/25"},
        (0.4, 0.0, 0.9), (-0.405, 0.84046118292280459132, 0.36), 0.16, 0.0, 7.124331997472408, 100,
    ),
    Worked(
        "goriatchev", {"A": 1, "B": "61/100", "C": "671/475"}, {"a": 1}, {},
        (1.0034172039966195287, 2.0726214680448652137, 1.7888846179921081154),
        (0.61250680616724906781, 0.58231713075450531735, -0.53454856807275832118),
        4.6864235055724417, 0.0, 4.821493368440772, 40,
    ),
    Worked(
        "steklov", {"A": 1, "B": "6/5", "C": "2/5"}, {"a": 1}, {},
        (1.3944336145780360048, 1.0206205526778414916, 4.1247896570812906928),
        (0.16666638337207142857, -0.85391256382991718928, 0.49300674436268244055),
        31 / 6, 0.0, 2.611553220020971, 8,
    ),
    Worked(
        "chaplygin", {"A": 1, "B": "31/20", "C": "189/316"}, {"a": 1}, {},
        (0.057495121920034371555, 0.52529695233068344052, 0.39292834394255990482),
        (-0.26167516253104694909, -0.25055085822800398498, 0.93206779622276447937),
        0.0, 0.0, 9.09947106830838, 40,
    ),
    Worked(
        "kowalewski", {"A": 1, "B": "5/8", "C": "9/8"}, {"a": 1}, {},
        (-0.1259890284747144487, 1.9444879789567831922, 1.4806240813663596853),
        (-0.089315567716853191178, 0.71194059370640569789, 0.69653666120053349251),
        7 / 3, 2.0367003088692622, 9.537016653695952, 60,
    ),
    Worked(
        "grioli", {"A": 3, "B": 2, "C": "3/2"}, {"a": "1.41421356237309504880168872421", "c": 1}, {},
        (1.0803630537091637204, 0.39144931307976527627, -0.11365052046921679448),
        (0.25641025876162892973, 0.57583713662345220055, -0.77631525251478740935),
        1.5, 2**0.5, 7.6952989809711845733, 100,
    ),
    Worked(
        "dokshevich_1965", {"A": 3, "B": 2, "C": "3/2"},
        {"a": "0.707106781186547524400844362105", "c": "0.707106781186547524400844362105"}, {},
        (0.67304880071045724665, 0.38517814850276213465, 0.24635287889241973634),
        (-0.33416737204232531521, 0.93454345383924266795, -0.12231394175867870363),
        0.550590511520996, 0.0, 7.404320634922648, 60,
    ),
    Worked(
        "konosevich_pozdnyakovich", {"A": 1}, {"a": 1}, {"solution": 1},
        (1.834878170106322072, 0.48505330284889045669, 1.2762644530724949458),
        (0.78821531264409345144, 0.15685445307806571101, 0.5950741982836719297),
        3.0954053193897892, 2.014141719734588674, 11.419721817760639, 20,
    ),
    Worked(
        "konosevich_pozdnyakovich", {"A": 1}, {"a": 1}, {"solution": 2},
        (1.6145675398966807386, 1.6842222363970820552, 0.39628782846967886843),
        (0.72700942068679444081, 0.66332381368220987844, 0.17736634527085587511),
        3.0672233026620350, 1.9939630534147483, 17.030487665744968, 30,
    ),
    Worked(
        "elliptic_x_minus_k_over_x", {"A": 1}, {"a": 1}, {},
        (-0.26077975331554460754, 0.29967051230494800541, 0.22529498876998825034),
        (-0.88900990559350934226, -0.31766665220202610407, -0.32977156614143765571),
        -0.759466496520015, 0.0, 6.4309110730287875, 60,
    ),
)  # fmt: skip
"""States, integrals and periods to the digits of a double, found by other programs than this one."""


def random_documents(name: str, seed: int, count: int) -> Iterator[Document]:
    """Yield problems of bodies drawn inside the real range of a case that has free parameters."""
    random = Random(f"{name} {seed}")

    def between(low: float, high: float) -> Fraction:
        return Fraction(round((low + (high - low) * random.uniform(0.02, 0.98)) * 10**6), 10**6)

    def sign(number: Fraction) -> Fraction:
        return number * random.choice((-1, 1))

    made = 0
    while made < count:
        size = sign(between(0.5, 2.0))
        potential: Document = {"a": str(size)}
        motion: Document = {"phase": str(between(0, 1))}
        body: Document
        match name:
            case "goriatchev":
                body = {"A": 1, "B": str(between(0.6, 0.625))}
            case "chaplygin":
                body = {"A": 1, "B": str(between(1.5, 1.5965))}
            case "kowalewski":
                body = {"A": 1, "B": str(between(10 / 17, 0.6469))}
            case "steklov":
                B, C = between(0.51, 1.4), between(0.05, 0.49)
                if not (B + C > 1 and B < 1 + C and abs(B - 1) > Fraction(1, 20)):
                    continue
                body = {"A": 1, "B": str(B), "C": str(C)}
            case "bobylev_steklov":
                p, a = sign(between(0.1, 0.9)), abs(size)
                e = between(-0.95, 0.95) * a
                body = {"A": 2, "B": str(between(1.05, 2.95)), "C": 1}
                motion |= {"p": str(p), "energy": str(e + p * p)}
            case _:
                A, C = between(1.2, 2.0), between(0.6, 1.0)
                body = {"A": str(A), "C": str(C)}
                potential["c"] = str(sign(between(0.5, 2.0)))
        if name == "hess":
            motion = _hess_state(random)
        elif name == "staude":
            body["B"], potential["b"] = str(between(1.0, 1.2)), str(sign(between(0.5, 2.0)))
            motion = {"gamma": [1, str(sign(between(0.2, 3.0))), None]}
        drawn = document(name, body, potential, motion)
        if has_possible_body(drawn):
            made += 1
            yield drawn


def has_possible_body(drawn: Document) -> bool:
    """Tell whether a body can have the moments, those that the case computes included."""
    try:
        read_problem(drawn)
    except InvalidProblemError as error:
        if any(fault.code != "unphysical_inertia" for fault in error.faults):
            raise
        return False
    return True


def _hess_state(random: Random) -> Document:
    # A rational point of the sphere: by stereographic projection.
    u, v = (Fraction(random.randint(-200, 200), 100) for _ in range(2))
    square = u * u + v * v
    gamma = [2 * u / (1 + square), 2 * v / (1 + square), (square - 1) / (square + 1)]
    omega = [Fraction(random.randint(-150, 150), 100), Fraction(random.randint(-150, 150), 100), None]
    return {"omega": [None if x is None else str(x) for x in omega], "gamma": [str(x) for x in gamma]}


FREE = ("hess", "staude", "bobylev_steklov", "goriatchev", "steklov", "chaplygin", "kowalewski", "grioli",
        "dokshevich_1965")  # fmt: skip
"""Cases with a free parameter of the body or of the motion."""
