"""Problems that were once answered wrongly, slowly or not at all, each with the truth about it.

Truths are numbers of other programs, quadratures done here, and other ways to write the same problem.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import mpmath as mp
from flint import arb, ctx

from tests.support.pole_passages import BITS, MOTIONS, period, power

Document = dict[str, Any]
Truth = Callable[[], str]
G = Callable[[mp.mpf], mp.mpf]
DIGITS = 60
"""Digits of quadratures: next to rest points and poles half of them are lost."""
Q = "(2*g1^2+g3^2)"
TIERS: tuple[Document, ...] = tuple({"tier": tier} for tier in ("draft", "standard", "high", "certified"))
SIZED = (*TIERS, {"relative": 1e-10})
RATIOS = ("101/100", "7/5", "2", "3", "10", "100")
"""A/C and C/A of the families."""
FUNCTIONS: Mapping[str, Callable[[mp.mpf], mp.mpf]] = {
    "-w^(3/7)": lambda w: -(w ** (mp.mpf(3) / 7)),
    "-w^(1/3)": lambda w: -mp.cbrt(w),
    "-sqrt(w)": lambda w: -mp.sqrt(w),
    "-exp(-w)": lambda w: -mp.exp(-w),
    "-log(2+w)": lambda w: -mp.log(2 + w),
    "w*log(w)": lambda w: w * mp.log(w),
}
"""F(w), of which V₁ is an integral for most A/C."""
SAME_AS = {
    "1e4*g1*(1+g3^2)-1e4*g1*g3^2-(1e4+1)*g1": "-g1",
    "1e6*(g1^2+g2^2+g3^2-1)-g1+1/20/g3^2": "-g1 + 1/(20*g3^2)",
    "-g1*sqrt(1-g2^2)/sqrt(g1^2+g3^2)": "-g1",
    "1e12-g1+1e12*sin(g3)^2+1e12*cos(g3)^2": "2e12 - g1",
    "-g1+sqrt(1-g1^2-g3^2)*g3-abs(g2)*g3": "-g1",
    f"{Q}*sqrt(g2^2-g2/5+1/100)": f"{Q}*abs(g2-1/10)",
    f"{Q}*sqrt(1-cos(g2)^2)": f"{Q}*abs(sin(g2))",
    f"{Q}*sqrt(2-2*cos(g2))": f"2*{Q}*abs(sin(g2/2))",
    f"{Q}*sqrt(1-cos(2*g2))": f"sqrt(2)*{Q}*abs(sin(g2))",
    f"{Q}*log(g2^2-2*g2/3+1/9)": f"2*{Q}*log(abs(g2-1/3))",
    f"{Q}*(8*g2^6+12*g2^4+6*g2^2+1)^(1/3)": f"{Q}*(1+2*g2^2)",
    "(8*g1^6+12*g1^4*g3^2+6*g1^2*g3^4+g3^6)^(1/3)*g2": f"{Q}*g2",
    f"{Q}*(g2^2)^(3/7)": f"{Q}*abs(g2)^(6/7)",
    f"-g1+{Q}*exp(-g2^2)/(1+25*g2^2)+1e5*tan(g1)*cos(g1)-1e5*sin(g1)": f"-g1+{Q}*exp(-g2^2)/(1+25*g2^2)",
    "sqrt(g1^2-2*g1*g3+g3^2)": "abs(g1-g3)",
    "abs(g1*g3)^(1/2)+1e5*(abs(g1)^(1/2)*abs(g3)^(1/2)-abs(g1*g3)^(1/2))": "abs(g1)^(1/2)*abs(g3)^(1/2)",
    "-g1*(g1^2+g2^2+g3^2)^20": "-g1",
    f"{Q}*sin(g2)/g2+1e7*(g1^2-(1-g2^2-g3^2))": f"{Q}*sin(g2)/g2",
}


@dataclass(frozen=True, slots=True)
class Hard:
    """A problem to be asked in several tiers."""

    kind: str
    name: str
    document: Document
    """Without accuracy."""
    accuracies: tuple[Document, ...] = TIERS
    truth: Mapping[str, Truth] = field(default_factory=dict)
    """Decimals by what they are: ``period``, ``end`` (when it ends), or ``p`` … at the last time."""
    window: str | None = None
    """The kind of its window."""
    same_as: Document | None = None
    """Another way to write the problem, which has the same samples or the same refusal."""


def expression(text: str) -> Document:
    return {"type": "expression", "expression": text}


def problem(A: object, potential: Document, *, C: object = 1, **motion: object) -> Document:
    """Return a planar problem, λ = 1, sampled at t = 0 and 1/4; B is one that a body can have."""
    return {
        "body": {"A": A, "B": str(max(Fraction(str(A)), Fraction(str(C)))), "C": C},
        "potential": potential,
        "motion": {"type": "planar", "lambda": 1, **motion},
        "time": {"times": [0, "1/4"]},
    }


def time_between(of_g2: G, low: mp.mpf, high: mp.mpf, *, own: int = 1) -> mp.mpf:
    """Return the time between two heights in V = −own g1 + Q G(g2), A = 2, C = 1, λ = 1 (theory.md, 3).

    There g3² = g1, s² = own/(2 g1) − G, and g2' = −Q s.
    """

    def rate(y: mp.mpf) -> mp.mpf:
        g1 = 2 * (1 - y * y) / (1 + mp.sqrt(5 - 4 * y * y))
        return mp.sqrt(2 / (own - 2 * g1 * of_g2(y)) / g1) / (2 * g1 + 1)

    # Next to a pole roundings may step over it.
    return mp.re(mp.quad(rate, mp.linspace(low, high, 9)))


def _time(of_g2: G, low: Truth, high: Truth, *, own: int = 1, factor: int = 1) -> Truth:
    def digits() -> str:
        with mp.workdps(DIGITS):
            return mp.nstr(factor * time_between(of_g2, mp.mpf(low()), mp.mpf(high()), own=own), 24)

    return digits


def _known(digits: str) -> Truth:
    return lambda: digits


def _rest(of_g2: G, about: float) -> Truth:
    """Return the height near ``about`` at which a motion in V = −g1 + Q G turns back."""

    def digits() -> str:
        with mp.workdps(DIGITS):
            found = mp.findroot(
                lambda y: 1 - 4 * (1 - y * y) / (1 + mp.sqrt(5 - 4 * y * y)) * of_g2(y), mp.mpf(about)
            )
            return mp.nstr(found, DIGITS)

    return digits


def poles() -> Iterator[Hard]:
    """Poles of p² inside the sphere, reached from the equator: the issue is when."""
    zero, half = _known("0"), _known("0.5")
    rising = {"at": "equator", "s_sign": -1}
    quarter = _workdps(lambda: mp.nstr(mp.pi / 4, DIGITS))
    cases: list[tuple[str, str, G, Truth]] = [
        ("order 1", f"-g1-{Q}/20/(1/2-g2)", lambda y: -1 / (10 - 20 * y), half),
        ("order 3", f"-g1-{Q}/20/(1/2-g2)^3", lambda y: -((1 / mp.mpf(2) - y) ** -3) / 20, half),
        ("order 5", f"-g1-{Q}/20/(1/2-g2)^5", lambda y: -((1 / mp.mpf(2) - y) ** -5) / 20, half),
        ("tan", f"-g1-{Q}*tan(2*g2)/10", lambda y: -mp.tan(2 * y) / 10, quarter),
        ("1/log", f"-g1+{Q}/20/log((g2+3)*2/7)", lambda y: 1 / mp.log((y + 3) * 2 / 7) / 20, half),
        ("power", f"-g1-{Q}/20/(1/2-g2)^(1/3)", lambda y: -1 / mp.cbrt(1 / mp.mpf(2) - y) / 20, half),
        ("quotient", f"-g1-{Q}/20*(1+g2)/(1/2-g2)", lambda y: -(1 + y) / (10 - 20 * y), half),
        ("weak", f"-g1-{Q}*1e-9/(1/2-g2)", lambda y: mp.mpf("-1e-9") / (1 / mp.mpf(2) - y), half),
        (
            "near the end",
            f"-g1-{Q}/20/(999999/1000000-g2)",
            lambda y: -1 / (mp.mpf(999999) / 50000 - 20 * y),
            _known("0.999999"),
        ),
        (
            "two",
            f"-g1-{Q}/20/((1/2-g2)*(g2+1/3))",
            lambda y: -1 / ((1 / mp.mpf(2) - y) * (y + 1 / mp.mpf(3))) / 20,
            half,
        ),
    ]
    for name, text, of_g2, place in cases:
        document = problem(2, expression(text), start=rising)
        if name in WINDOWS:
            document["motion"]["window"] = WINDOWS[name]
        digits = _time(of_g2, zero, place)
        yield Hard("poles", name, document, truth={"end": digits}, window="collision")
    # Of another program, 25 digits.
    first = problem(2, expression(cases[0][1]), start=rising, window=WINDOWS["order 1"])
    told = {"end": _known("0.3640004182936566138400526")}
    yield Hard("poles", "order 1, by another program", first, truth=told, window="collision")
    alone = problem(2, expression(f"-{Q}/20/(1/2-g2)"), start=rising)
    digits = _time(lambda y: -1 / (10 - 20 * y), zero, half, own=0)
    yield Hard("poles", "F constant", alone, truth={"end": digits}, window="collision")
    # g1 = 1/2 on g3² = g1 is at g2 = 1/2.
    inside = problem(
        2, expression(f"-g1-{Q}/20/g2"), window=1, start={"g1": "1/2", "g2_sign": 1, "s_sign": 1}
    )
    digits = _time(lambda y: -1 / (20 * y), zero, half)
    yield Hard("poles", "equator", inside, truth={"end": digits}, window="collision")


WINDOWS = {
    **dict.fromkeys(("order 1", "order 3", "order 5", "1/log", "quotient", "weak", "near the end"), 1),
    **dict.fromkeys(("tan", "two"), 2),
}
"""Windows from the equator to the pole, where there are others."""


def states() -> Iterator[Hard]:
    """A body that passes its unstable axis again and again; digits of another program."""
    document: Document = {
        "body": {"A": 3, "B": 2, "C": "3/2"},
        "potential": {"type": "gravity"},
        "motion": {"type": "state", "omega": ["2e-9", 5, "3e-9"], "gamma": ["3/5", 0, "4/5"]},
        "time": {"times": [0, 31]},
    }
    told = {"p": _known("9.457515547478334608278e-7"), "r": _known("-1.891501259114510060422e-6")}
    tolerances: tuple[Document, ...] = ({"tolerance": 1e-2}, {"relative": 1e-2})
    yield Hard("states", "free body", document, (*TIERS, *tolerances), told)


def passages() -> Iterator[Hard]:
    """Motions through poles, beside quadratures."""
    for name, motion in MOTIONS.items():
        kind = "slow" if name in ("root", "next to 1", "a million") or name.startswith("log") else "passages"
        yield Hard(kind, name, with_B(motion.document()), truth={"period": _period(name)})
    told = {"a2": "6.474555420702909342109184", "7/5": "4.438340523080240605568"}
    for name, digits in told.items():
        document = with_B(MOTIONS[name].document())
        yield Hard("passages", f"{name}, by another program", document, truth={"period": _known(digits)})
    both = problem("3/2", {"type": "homogeneous", "B": [-1, "1/10", "1/50"]})
    yield Hard("passages", "B_1 and B_2", both)
    a3 = problem(2, {"type": "rational", "a": [-1, "1/100", "1/1000"]})
    yield Hard("passages", "a2 and a3", a3)
    formula = expression(f"-g1 + sqrt(2)/3*{Q}/sqrt(g1^2 + g3^2)")
    general = problem(2, {"type": "general", "F": "-sqrt(w)/2", "G": "0"})
    yield Hard("passages", "F = -sqrt(w)/2", general, same_as=problem(2, formula))


def with_B(document: Document) -> Document:
    """Return the problem sampled at t = 0 and 1/4, with a B."""
    return problem(document["body"]["A"], document["potential"])


def _period(name: str) -> Truth:
    def digits() -> str:
        with ctx.workprec(BITS):
            return str(period(name).str(26, radius=False))

    return digits


def cancellation() -> Iterator[Hard]:
    """Formulas of which most cancels on the sphere, beside short ones."""
    for text, short in SAME_AS.items():
        # Functions of g2 alone have motions where they are negative.
        turned = [f"-({each})" if text.startswith(Q) else each for each in (text, short)]
        first, second = (problem(2, expression(each)) for each in turned)
        yield Hard("cancellation", text, first, same_as=second)


def zeros() -> Iterator[Hard]:
    """Zeros of third and higher order of functions, and one of fractional order."""
    start = {"g1": "1/2", "g2_sign": 1, "s_sign": 1}
    for text in ("sin(g2)-g2", "tan(g2)-g2", "exp(g2)-1-g2-g2^2/2"):
        sign = "" if text.startswith("sin") else "-"
        yield Hard(
            "zeros", text, problem(2, expression(f"{sign}{Q}*({text})"), start=start), window="separatrix"
        )
    text = f"{Q}*(g2-1/2)*abs(g2-1/2)^(1/3)"
    yield Hard("zeros", "fractional", problem(2, expression(text)), window="standstill")


def slow() -> Iterator[Hard]:
    """Functions of w that had no answer; the others are passages."""
    for F in ("-w^(3/7)", "-sqrt(w)", "-w^2"):
        yield Hard("slow", f"F = {F}", problem(2, {"type": "general", "F": F, "G": "0"}))


def families() -> Iterator[Hard]:
    """Every family of the paper, for A/C from 1/100 to 100."""
    yield Hard("families", "gravity, A = 2C", problem(2, {"type": "gravity", "a": -1}))
    yield Hard("families", "gravity, C = 2A", problem(1, {"type": "gravity", "c": -1}, C=2))
    lists = {
        "a": [-1, "1/100", "1/1000"],
        "b": ["1/50", "1/500", "1/4000"],
        "c": ["1/5", "1/10"],
    }
    for names in ("a", "ab", "ac", "abc"):
        potential = {"type": "rational", **{name: lists[name] for name in names}}
        yield Hard("families", f"rational, {names}", problem(2, potential))
    for ratio in RATIOS:
        for A, C, first, second, sign in ((ratio, "1", "B", "C", -1), ("1", ratio, "C", "B", 1)):
            # The exchange of the axes makes (-1)^n C_n of B_n.
            lines = {
                "first": {first: [-1]},
                "wall": {first: [-1], second: ["1/100"]},
                "two terms": {first: [-1, f"{-sign}/40"], "A": [0, "3/20"]},
                "libration": {"A": ["-1/2", "1/10", 1]},
            }
            for name, terms in lines.items():
                told = {"period": _period_of(ratio)} if name == "first" else {}
                where = f"{name}, A/C = {Fraction(A) / Fraction(C)}"
                yield Hard("families", where, problem(A, {"type": "homogeneous", **terms}, C=C), truth=told)


def _period_of(ratio: str) -> Truth:
    def digits() -> str:
        with ctx.workprec(BITS):
            motion = power(ratio, 240 if Fraction(ratio) > 5 else 120)
            return str((2 * (motion.time(arb(0)) + motion.time(arb(0), -1))).str(26, radius=False))

    return digits


def integrals() -> Iterator[Hard]:
    """V₁ that stays an integral."""
    for ratio in ("3/2", "3"):
        for A, C in ((ratio, 1), (1, ratio)):
            for F in FUNCTIONS:
                name = f"F = {F}, A/C = {Fraction(A) / Fraction(C)}"
                document = problem(A, {"type": "general", "F": F, "G": "0"}, C=C)
                tiers: tuple[Document, ...] = (*TIERS[1:3], {"tier": "certified", "bits": 64})
                yield Hard("integrals", name, document, tiers)
    wide = problem(2, {"type": "general", "F": "-exp(-w)", "G": "0"})
    yield Hard("integrals", "333 bits", wide, ({"tier": "certified", "bits": 333},))


def sizes() -> Iterator[Hard]:
    """Sizes far from 1; what is similar to V = −g1 has its period, scaled."""
    base = "6.432310535121612579869958267408"

    def scaled(exponent: int) -> Truth:
        return _known(f"{base}e{exponent}")

    strong = problem(2, {"type": "gravity", "a": "-1e30"}) | {"time": {"times": [0, "2.5e-16"]}}
    yield Hard("sizes", "a = -1e30", strong, SIZED, {"period": scaled(-15)})
    light = problem("2e-20", {"type": "gravity", "a": -1}, C="1e-20") | {"time": {"times": [0, "2.5e-11"]}}
    yield Hard("sizes", "moments of 1e-20", light, SIZED, {"period": scaled(-10)})
    # theory.md, S6: up to 1/ν² of it the half period is π √(2/ν), and 2 K(1/2) for ν → 0.
    far = problem(2, {"type": "gravity", "a": -1}, **{"lambda": "1e9"}) | {"time": {"times": [0, "1e-9"]}}

    def fast() -> str:
        return mp.nstr(mp.mpf(2) * mp.pi * mp.sqrt(2) / 10**9, 25)

    yield Hard("sizes", "lambda = 1e9", far, SIZED, {"period": _workdps(fast)})
    near = problem(2, {"type": "gravity", "a": -1}, **{"lambda": "1e-200"})
    slowest = {"period": _workdps(lambda: mp.nstr(4 * mp.ellipk(mp.mpf(1) / 2), 25))}
    yield Hard("sizes", "lambda = 1e-200", near, SIZED, slowest)


def _workdps(digits: Truth) -> Truth:
    def found() -> str:
        with mp.workdps(DIGITS):
            return digits()

    return found


def others() -> Iterator[Hard]:
    """Attitudes, classical cases, high degrees."""
    plain = problem(2, {"type": "gravity", "a": -1})
    attitude = {**plain, "outputs": ["gamma", "omega", "orientation"]}
    yield Hard("others", "attitude", attitude, truth={"period": _known("6.432310535121612579869958267408")})
    expanded = "8*g1^6*g2^3+12*g1^4*g2^3*g3^2+6*g1^2*g2^3*g3^4+g2^3*g3^6"
    for cube in (f"{Q}^3*g2^3", expanded):
        # Defined in the north only, where it turns back before the equator.
        first, second = (problem(2, expression(f"{Q}/10-{root}")) for root in (f"({cube})^(1/3)", f"{Q}*g2"))
        yield Hard("others", f"root of {cube}", first, same_as=second)
    yield Hard("others", "degree 40", problem(2, expression("-g1*(g1^2+g2^2+g3^2)^20")), same_as=plain)
    integrable: Document = {
        "body": {"A": 4, "B": 4, "C": 1},
        "potential": {"type": "gravity", "a": -1},
        "motion": {"type": "state", "omega": ["1/4", "1/2", "-3/4"], "gamma": ["3/5", 0, "4/5"]},
        "time": {"times": [0, 1]},
        "outputs": ["gamma", "omega", "invariants"],
    }
    yield Hard("others", "Goriachev-Chaplygin", integrable)
    hess: Document = {
        "body": {"A": 3, "B": 2, "C": "3/2"},
        "potential": {"type": "gravity", "a": 1, "c": 1},
        "motion": {
            "type": "classical",
            "case": "hess",
            "omega": ["3/10", "7/10", None],
            "gamma": ["3/5", "12/25", "16/25"],
        },
        "time": {"times": [0, "1/4"]},
    }
    yield Hard("others", "Hess", hess, (*TIERS, {"tolerance": 1e-12}))


def narrow() -> Iterator[Hard]:
    """Where a tier may save time."""
    texts = {
        "feature 1e-3": f"-g1+{Q}/10000000/(1e-6+(g2-1/2)^2)",
        "gaussian 1e-4": f"-g1+{Q}/10*exp(-1e8*(g2-1/3)^2)",
        "exp": f"-g1+{Q}/10*exp(g2)",
        "sin": f"-g1+{Q}/10*sin(3*g2)",
        "polynomial": "-g1",
    }
    for name, text in texts.items():
        yield Hard("narrow", name, problem(2, expression(text)))


KINDS: Mapping[str, tuple[str, Callable[[], Iterator[Hard]]]] = {
    "poles": ("poles of p² inside the sphere", poles),
    "states": ("a state next to an unstable axis", states),
    "passages": ("passages of a pole", passages),
    "cancellation": ("formulas written with cancellation", cancellation),
    "zeros": ("zeros of third and of fractional order", zeros),
    "slow": ("what was slow, or had no answer", slow),
    "families": ("every family, A/C from 1/100 to 100", families),
    "integrals": ("V₁ that stays an integral, A/C from 1/3 to 3", integrals),
    "sizes": ("sizes far from 1", sizes),
    "others": ("attitudes, classical cases, high degrees", others),
    "narrow": ("narrow features and functions", narrow),
}
"""Kinds of problems in words, and what makes them."""


def hard_problems() -> list[Hard]:
    return [each for _, make in KINDS.values() for each in make()]
