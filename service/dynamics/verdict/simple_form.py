"""Finds a simpler formula that is proved equal to a potential on the sphere, for bounds to be taken of it.

Bounds are taken of a formula as it is written: what cancels on the sphere, such as 1e6 (g1² + g2² + g3² − 1),
or hides there, such as the square under √(g2² − g2/5 + 1/100), makes them useless. The exact ring has a
normal form of every formula it reads (:mod:`.exact_ring`); written as a formula, and read again to the same
element, it is used where that tells more: where it has fewer functions, or intervals of it are much narrower.
A formula that is as good as it stands is left as it was typed, to its last digit.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import product
from math import inf, log2

from flint import arb, ctx, fmpq

from service.dynamics.errors import FormulaError
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.parser import parse
from service.dynamics.formula.rewriting import RegisterPolynomials, copied, with_half_angles
from service.dynamics.formula.tape import Instruction, Tape, compile_tape
from service.dynamics.formula.tree import Tree, format_tree
from service.dynamics.potentials.families.general_formula import formula_of
from service.dynamics.potentials.families.general_solution import GeneralPotential
from service.dynamics.potentials.potential import FormulaPotential, Notice, Potential
from service.dynamics.verdict.exact_ring.generators import (
    MAX_TERM_PRODUCTS,
    Element,
    Layout,
    NoProofError,
    UndefinedInOctantError,
    Work,
)
from service.dynamics.verdict.exact_ring.ring import Ring
from service.dynamics.verdict.proofs.element_text import ElementText, NoTextError
from service.dynamics.verdict.proofs.proof import Signs, octants_of, same_on_sphere
from service.dynamics.verdict.ring_functions.ring_algebra import RingAlgebra, in_large_enough_ring
from service.dynamics.verdict.sphere.switches import normalise

SIMPLER_POTENTIAL = "simpler_potential"
"""The code of the warning."""
MAX_SEARCH_PRODUCTS = MAX_TERM_PRODUCTS // 10
"""Products of terms that one search may take: some tenths of a second."""
MAX_LOST_ROUNDINGS = 2.0**8
"""Roundings of the largest value that a formula may lose at a place, before a simpler one is looked for."""
NARROWER_BITS = 3.0
"""Bits by which intervals of a simpler formula are narrower in the mean, if it has as many functions."""
BETTER_BITS = 0.5
"""Bits that a longer formula gains beside a shorter one, or any where a sum is a number on the sphere."""
MAX_POINT_BITS, UNBOUNDED_BITS = 8.0, 12.0
"""Bits that one place counts at most, and those that it counts where one of the formulas has no bound at all:
few more, since 1/(1 − g2²) has none next to the pole, where it is written otherwise anyway."""
_DOUBLE_BITS = 53
_INTERVAL = arb(0, arb(2) ** -20)
_PLACES = (
    ((2, 7), (6, 7)),
    ((-6, 7), (-3, 7)),
    ((3, 7), (-1, 9)),
    ((-1, 5), (4, 7)),
    ((1, 1000003), (-1, 700001)),
    ((-1, 900007), (1, 30011)),
    ((3, 5), (4, 5)),
    ((-20, 29), (21, 29)),
    ((1, 800011), (2, 3)),
    ((-5, 9), (1, 600011)),
)
"""g1 and g3, g2 taking both signs: next to the poles, on the equator, next to g1 = 0 and to g3 = 0, and
anywhere."""


def simplified(potential: Potential) -> Potential:
    """Return the potential by a simpler formula that is equal on the sphere, or as it is.

    An integral that has a formula is given by it. What it was before is :attr:`.Potential.as_stated`, and a
    notice says so.
    """
    if is_simplified(potential):
        return potential
    formula = formula_of(potential) if isinstance(potential, GeneralPotential) else potential
    if not isinstance(formula, FormulaPotential):
        return potential
    derived = formula.tape.derived
    if simplified not in derived:
        tree = _simpler(formula.tape) or formula.tree
        # 1 - cos x = 2 sin(x/2)² keeps the digits where it is small, and shows a bound that it is positive.
        tree = with_half_angles(tree)
        is_as_good = tree is formula.tree and potential.has_formula
        if isinstance(potential, GeneralPotential):
            # A quotient g1/|g1| that is left of F and G of quadrants has no bounds next to a pole.
            made = compile_tape(tree).instructions
            is_as_good = not potential.is_uniform and any(each.name == "abs" for each in made)
        derived[simplified] = None if is_as_good else with_simpler(potential, tree)
    found: FormulaPotential | None = derived[simplified]
    return potential if found is None else replace(found.alone(), stated=potential)


def is_simplified(potential: Potential) -> bool:
    """Tell whether a potential is given by a simpler formula than was typed."""
    return potential.as_stated is not potential


def with_simpler(potential: Potential, tree: Tree) -> FormulaPotential:
    """Return the potential by the formula of ``tree``, which was proved to be equal."""
    use = "this simpler formula, whose bounds are narrower" if potential.has_formula else "it"
    text = f"on the sphere V is {format_tree(tree)}, which is proved; windows and solvers use {use}"
    notice = Notice(SIMPLER_POTENTIAL, text, "/potential")
    return FormulaPotential(
        tree, compile_tape(tree), potential.family, (*potential.notices, notice), potential
    )


def _simpler(tape: Tape) -> Tree | None:
    """Return the tree of a simpler formula, None where there is none, or none is needed."""
    if not _may_hide(tape):
        return None
    texts = dict[str, None]()
    # The first has even powers under roots as absolute values, the other odd ones as they are.
    for read in dict.fromkeys((normalise(tape), tape)):
        with suppress(NoProofError, UndefinedInOctantError):
            texts |= dict.fromkeys(_texts(read))
    widths = [_bits_of(value) for value in _values(tape, _INTERVAL)]
    needed = BETTER_BITS if _has_constant_sum(tape) else NARROWER_BITS
    best, least = None, 0.0
    for text in texts:
        with suppress(FormulaError):
            tree = parse(text)
            simple = compile_tape(tree)
            gain = _gain(simple, tape, widths, needed)
            if gain > least + BETTER_BITS * (best is not None):
                best, least = (tree, simple), gain
    if best is None or not same_on_sphere(tape, best[1], Work(MAX_TERM_PRODUCTS - MAX_SEARCH_PRODUCTS)):
        return None
    return best[0]


def _texts(tape: Tape) -> Iterator[str]:
    """Yield formulas of a formula's normal form, the shortest first."""
    rings, elements, dependent = _read(tape, Work(MAX_TERM_PRODUCTS - MAX_SEARCH_PRODUCTS))
    for divisors, without in product((False, True), (None, 1, 0, 2)):
        with suppress(NoProofError, NoTextError):
            yield ElementText(rings, dependent, divisors=divisors, without=without).of(elements)


def _read(tape: Tape, work: Work) -> tuple[dict[Signs, Ring], dict[Signs, Element], frozenset[int]]:
    """Return the formula's element in each octant, in rings of one layout, and the signs that matter."""
    layout, dependent = Layout(), frozenset[int]()
    rings, elements = dict[Signs, Ring](), dict[Signs, Element]()

    def compute(ring: Ring, algebra: RingAlgebra) -> Element:
        found = tape.evaluate(algebra, [ring.coordinate(position) for position in range(3)])
        if not algebra.has_value_everywhere:
            raise NoProofError("a formula that has no value in a part of the sphere")
        return found

    pending: list[Signs] = [(1, 1, 1)]
    while pending:
        signs = pending.pop()
        ring, elements[signs] = in_large_enough_ring(layout, signs, compute, work, keeps_kinks=True)
        rings[signs], dependent = ring, dependent | ring.sign_dependent
        if ring.layout != layout:
            layout = ring.layout
            rings = {signs: ring}
        pending = [octant for octant in octants_of(dependent) if octant not in rings]
    return rings, {signs: elements[signs] for signs in rings}, dependent


def _may_hide(tape: Tape) -> bool:
    """Tell whether something may cancel in a formula, or hide in its functions: cheap, and true too often."""
    made: list[Instruction | None] = [None] * len(tape.variables)
    trigonometric = set[str]()
    for instruction in tape.instructions:
        operation, left, _, number, name = instruction
        made.append(instruction)
        inner = made[left] if left >= 0 else None
        while inner is not None and inner.operation == "call" and inner.name == "abs":
            inner = made[inner.left]
        is_root = operation == "power" and number is not None and number.denominator != 1
        if (is_root or name == "log") and inner is not None and inner.operation != "constant":
            return True
        trigonometric |= {name} & {"sin", "cos", "tan"}
    if "tan" in trigonometric or len(trigonometric) == 2:
        return True
    if _has_constant_sum(tape):
        return True
    values = _values(tape, arb(0))
    sizes = sorted(float(abs(value).upper()) for value in values)
    usual = sizes[len(sizes) // 2]
    return not all(
        float(value.rad()) <= MAX_LOST_ROUNDINGS * 2.0**-_DOUBLE_BITS * max(usual, float(abs(value).lower()))
        for value in values
    )


def _has_constant_sum(tape: Tape) -> bool:
    """Tell whether a polynomial in the formula is a number on the sphere, as g1² + g2² + g3² is."""
    builder, registers = copied(tape)
    polynomials = RegisterPolynomials(builder, (0, 1, 2))
    for register, made in enumerate(tape.instructions, start=len(tape.variables)):
        if made.operation in ("add", "subtract"):
            found = polynomials.of(registers[register])
            if found is not None and not found.is_constant() and polynomials.on_sphere(found).is_constant():
                return True
    return False


def _gain(simple: Tape, tape: Tape, widths: Sequence[float], needed: float) -> float:
    """Return how many bits narrower intervals of a formula are, in the mean; 0 where that is not enough.

    Fewer functions are enough where intervals are not twice as wide.
    """
    ratios = [
        0.0 if inf == one == other else max(-UNBOUNDED_BITS, min(other - one, UNBOUNDED_BITS))
        for one, other in zip(map(_bits_of, _values(simple, _INTERVAL)), widths, strict=True)
    ]
    gain = sum(
        r if abs(r) == UNBOUNDED_BITS else max(-MAX_POINT_BITS, min(r, MAX_POINT_BITS)) for r in ratios
    ) / len(ratios)
    has_fewer = _functions(simple) < _functions(tape) and gain > -1.0
    return 2.0 + gain if has_fewer else gain if gain > needed else 0.0


def _bits_of(value: arb) -> float:
    """Return log2 of the radius; of none that of the least double."""
    radius = float(value.rad()) if value.is_finite() else inf
    return log2(radius) if 0.0 < radius < inf else inf if radius else -1074.0


def _functions(tape: Tape) -> int:
    """Return the number of functions and roots in a formula but absolute values, and again those of a sum."""
    count, absolutes, numbers = 0, set[int](), set[int]()
    for register, made in enumerate(tape.instructions, start=len(tape.variables)):
        if made.name == "abs":
            absolutes.add(register)
            continue
        if made.operation == "constant":
            numbers.add(register)
        is_root = made.operation == "power" and made.number is not None and made.number.denominator != 1
        if (is_root or made.operation in ("call", "general_power")) and made.left not in numbers:
            count += 1 + ((is_root or made.name == "log") and made.left not in absolutes)
    return count


def _values(tape: Tape, width: arb) -> list[arb]:
    """Return balls of a formula all over the sphere, each coordinate being so wide against itself."""
    found = list[arb]()
    with ctx.workprec(_DOUBLE_BITS):
        for first, third in _PLACES:
            g1, g3 = arb(fmpq(*first)), arb(fmpq(*third))
            rest = 1 - g1 * g1 - g3 * g3
            g2 = rest.sqrt() if rest > 0 else arb(0) + width
            found += [
                tape.evaluate(BallAlgebra(), [x * (1 + width) for x in (g1, side * g2, g3)])
                for side in (1, -1)
            ]
    return found
