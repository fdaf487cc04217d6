r"""Writes V1[F] + Q G(g2) as a formula where F is a constant k: V = −k + Q (G + k / (C T₀ (1 − g2²))).

For V1[k] = −k T (1/T − 1/T₀) with T = Q / (C ρ), ρ = 1 − g2², and T₀ = α cos² φ₀ + sin² φ₀ in the reference
direction (theory.md, 2.2).
"""

from fractions import Fraction

from service.dynamics.body import RigidBody
from service.dynamics.formula.printer import exact_tree
from service.dynamics.formula.tape import compile_tape
from service.dynamics.formula.tree import Binary, Call, Symbol, Tree
from service.dynamics.potentials.families.general_solution import FAMILY, GeneralPotential
from service.dynamics.potentials.potential import FormulaPotential, Potential


def formula_of(body: RigidBody, potential: GeneralPotential) -> FormulaPotential | None:
    """Return the same potential by its formula if F is one constant on all quadrants, else None."""
    piece = potential.pieces[0]
    if not potential.is_uniform or not _is_constant(piece.F):
        return None
    one, two = exact_tree(Fraction(1)), exact_tree(Fraction(2))
    squares = [Binary("^", Call(name, potential.reference_angle), two) for name in ("cos", "sin")]
    T = Binary("+", Binary("*", exact_tree(body.alpha), squares[0]), squares[1])
    rho = Binary("-", one, Binary("^", Symbol("g2"), two))
    share = Binary("/", piece.F, Binary("*", Binary("*", exact_tree(body.C), T), rho))
    moments = [
        Binary("*", exact_tree(moment), Binary("^", Symbol(name), two))
        for moment, name in ((body.A, "g1"), (body.C, "g3"))
    ]
    Q = Binary("+", moments[0], moments[1])
    whole = Binary("-", Binary("*", Q, Binary("+", piece.G, share)), piece.F)
    return Potential.from_tree(whole, FAMILY)


def _is_constant(F: Tree) -> bool:
    tape = compile_tape(F, ("w",))
    return tape.result != 0 and all(0 not in (made.left, made.right) for made in tape.instructions)
