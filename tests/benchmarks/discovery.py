"""Proofs and searches of discovery beside SymPy and Singular, which do what they can do of each.

All get the same mathematics: the derivative of a function in time, an ansatz of monomials, the matrix of L.
Each rival has its own polynomials and its own linear algebra. Singular is used where it is installed, by a
process, whose start is part of its time; without it its cell is empty.
"""

import resource
import shutil
import subprocess
from collections.abc import Callable
from itertools import combinations_with_replacement
from math import prod

import sympy as sp
from sympy.polys.matrices import DomainMatrix

from service.dynamics.discovery.closure import on_zero_areas
from service.dynamics.discovery.functions import Functions
from service.dynamics.discovery.integral_search import search_integrals
from service.dynamics.discovery.judgement import judge_integral
from service.dynamics.discovery.potential_search import search_potentials
from service.dynamics.discovery.setting import LetteredSetting, read_setting
from service.dynamics.equations.compatibility import pde_residual
from service.dynamics.formula.algebras.symbolic import SymbolicAlgebra
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from tests.benchmarks.measuring import Effort, Table, in_words, median

NAMES = sp.symbols("p q r g1 g2 g3")
P, Q, R, G1, G2, G3 = NAMES
C, A = sp.symbols("C A")
FREE = sp.symbols("a b c1 c2")
FIELD = "a*g1 + b*g2 + c1*(g1^2 - g2^2) + 2*c2*g1*g2"
INTEGRAL = "(C*(p^2 - q^2) - (a*g1 - b*g2) + c1*g3^2)^2 + (2*C*p*q - (a*g2 + b*g1) + c2*g3^2)^2"
DEGREE = 8
SPHERE = G1**2 + G2**2 + G3**2 - 1


def discovery(effort: Effort) -> Table:
    """Return the times of ours and of the rivals, and the ratio to the faster of them."""
    repeats = effort.repeats(5)
    rows = [
        _row("dK/dt = 0 of Goriachev's, 5 letters", repeats, _proof, _proof_by_sympy, _singular()),
        _row("the same as a judgement", repeats, _judgement),
        _row("Kovalevskaya's found from its degree", repeats, _search, _search_by_sympy),
        _row(f"all V to degree {DEGREE} for nearly all A/C", repeats, _potentials, _kernels_by_sympy),
    ]
    remark = (
        "Processor time, medians; of Singular the least. A judgement also tells whether the integral is "
        "independent, and its name; a search of potentials every ratio A/C with more of them."
    )
    return Table("Proofs and searches", remark, ("task", "here", "SymPy", "Singular", "faster"), tuple(rows))


def _row(
    task: str,
    repeats: int,
    ours: Callable[[], object],
    by_sympy: Callable[[], object] | None = None,
    by_singular: Callable[[], float] | None = None,
) -> tuple[str, ...]:
    own = median(ours, repeats)
    rivals = [
        None if by_sympy is None else median(by_sympy, 1),
        None if by_singular is None else min(by_singular() for _ in range(repeats)),
    ]
    known = [each for each in rivals if each is not None]
    cells = ("—" if each is None else in_words(each) for each in rivals)
    return (task, in_words(own), *cells, f"{min(known) / own:.3g}×" if known else "—")


def _setting() -> LetteredSetting:
    return read_setting({"A": "2*C", "B": "2*C"}, FIELD, dict.fromkeys(map(str, FREE)))


def _proof() -> None:
    setting = _setting()
    tape = setting.tape(setting.read(INTEGRAL, ""))
    field = Functions(setting, [tape, setting.tape(setting.potential)])
    rate = field.along(field.gradient(tape), field.rates())
    assert not field.reduced(rate.numerator, on_zero_areas(field).relations)


def _judgement() -> None:
    setting = _setting()
    assert judge_integral(setting, INTEGRAL, areas_zero=True).holds == "zero_areas"


def _search() -> None:
    setting = read_setting({"A": "2", "B": "2", "C": "1"}, "-g1")
    assert len(search_integrals(setting, 4, 2).integrals) == 1


def _potentials() -> None:
    assert search_potentials(None, DEGREE).dimension == DEGREE


def _expression(text: str) -> sp.Expr:
    names = (*NAMES, C, *FREE)
    return compile_tape(parse(text), [str(name) for name in names]).evaluate(SymbolicAlgebra(), names)


def _rates(C: sp.Expr, V: sp.Expr) -> tuple[sp.Expr, ...]:
    """Return the equations of motion of a body with A = B = 2C, times 2C."""
    V1, V2, V3 = (sp.diff(V, name) for name in (G1, G2, G3))
    return (
        C * Q * R + G2 * V3 - G3 * V2,
        -C * P * R + G3 * V1 - G1 * V3,
        2 * (G1 * V2 - G2 * V1),
        2 * C * (R * G2 - Q * G3),
        2 * C * (P * G3 - R * G1),
        2 * C * (Q * G1 - P * G2),
    )


def _proof_by_sympy() -> None:
    K, rates = _expression(INTEGRAL), _rates(C, _expression(FIELD))
    rate = sum(sp.diff(K, name) * each for name, each in zip(NAMES, rates, strict=True))
    areas = 2 * C * (P * G1 + Q * G2) + C * R * G3
    domain = sp.QQ.frac_field(C, *FREE)
    basis = sp.groebner([SPHERE, areas], R, Q, P, G3, G2, G1, order="lex", domain=domain)
    assert basis.reduce(sp.expand(rate))[1] == 0


def _search_by_sympy() -> None:
    """Solve for the coefficients of as many monomials, those without g1² on the sphere."""
    # Division of polynomials is in the first of their generators.
    gens = (G1, P, Q, R, G2, G3)
    rates = [sp.Poly(each, gens) for each in _rates(sp.Integer(1), -G1)]
    sphere = sp.Poly(SPHERE, gens)
    monomials = [
        prod((*omega, *gamma), start=sp.Integer(1))
        for n in range(5)
        for omega in combinations_with_replacement((P, Q, R), n)
        for k in range(3)
        for gamma in combinations_with_replacement((G1, G2, G3), k)
        if gamma.count(G1) < 2
    ][1:]
    columns = []
    for monomial in monomials:
        total = sp.Poly(0, gens)
        for name, rate in zip(NAMES, rates, strict=True):
            total += sp.Poly(sp.diff(monomial, name), gens) * rate
        columns.append(total.rem(sphere).as_dict())
    # H, I3, their three products, and Kovalevskaya's.
    assert len(_null(columns, sp.QQ)) == 6


def _kernels_by_sympy() -> None:
    """Solve L(V) = 0 for the homogeneous polynomials of every degree, over the rational functions of A."""
    dimensions = []
    for n in range(DEGREE + 1):
        columns = []
        for chosen in combinations_with_replacement((G1, G2, G3), n):
            V = prod(chosen, start=sp.Integer(1))
            first = [sp.diff(V, name) for name in (G1, G2, G3)]
            second = [[sp.diff(part, name) for name in (G1, G2, G3)] for part in first]
            residual = pde_residual(A, sp.Integer(1), (G1, G2, G3), first, second)
            columns.append(sp.Poly(residual, G1, G2, G3).as_dict())
        dimensions.append(len(_null(columns, sp.QQ.frac_field(A))))
    assert dimensions[-1] + dimensions[-2] == DEGREE


def _null(columns: list[dict[tuple[int, ...], sp.Expr]], domain: sp.Domain) -> list[object]:
    rows = {place: number for number, place in enumerate({each for column in columns for each in column})}
    table = {number: {} for number in rows.values()}
    for k, column in enumerate(columns):
        for place, value in column.items():
            if value != 0:
                table[rows[place]][k] = domain.from_sympy(value)
    shape = (max(len(rows), 1), len(columns))
    return DomainMatrix({n: row for n, row in table.items() if row}, shape, domain).nullspace().to_list()


def _seconds_of_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _singular() -> Callable[[], float] | None:
    program = shutil.which("Singular")
    if program is None:
        return None
    rates = ",".join(str(each).replace("**", "^") for each in _rates(C, _expression(FIELD)))
    script = f"""
        ring R = (0,C,a,b,c1,c2),(r,q,p,g3,g2,g1),lp;
        ideal I = std(ideal(g1^2+g2^2+g3^2-1, 2*C*p*g1+2*C*q*g2+C*r*g3));
        poly K = {INTEGRAL};
        ideal F = {rates};
        ideal J = diff(K,p),diff(K,q),diff(K,r),diff(K,g1),diff(K,g2),diff(K,g3);
        poly d; int k; for (k=1; k<=6; k++) {{ d = d + J[k]*F[k]; }}
        print(reduce(d, I)); quit;
    """

    def run() -> float:
        before = _seconds_of_children()
        done = subprocess.run([program, "-q"], input=script, capture_output=True, text=True, check=True)
        assert done.stdout.split()[-1] == "0"
        return _seconds_of_children() - before

    return run
