"""User formulas never meet an evaluator: parsing and building with every evaluator broken."""

import builtins
import importlib
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest
import sympy
from flint import arb

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError, FormulaError
from service.dynamics.formula.algebras.symbolic import sympy_expression
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tree import format_tree
from service.dynamics.potentials.families.written import expression_potential
from tests.support.formulas import POTENTIALS, PRECEDENCE, REFUSED

ROOT = Path(__file__).parents[3]
BODY = RigidBody(Fraction(2), None, Fraction(1))


def _evaluator(*args: object, **options: object) -> NoReturn:
    raise AssertionError("an evaluator was called")


@contextmanager
def _broken_evaluators() -> Iterator[None]:
    """Break what could run a text. A context, not a fixture: pytest itself may use exec between tests."""
    # By name: sympy.core.sympify, read as an attribute, is the function and not its module.
    core = importlib.import_module("sympy.core.sympify")
    parser = importlib.import_module("sympy.parsing.sympy_parser")
    inner = core.sympify

    def refuse_text(a: object, *args: object, **options: object) -> object:
        # SymPy's operators call this on every operand; only a text would be evaluated.
        assert not isinstance(a, str | bytes)
        return inner(a, *args, **options)

    with pytest.MonkeyPatch.context() as patch:
        for module, name in [
            (builtins, "eval"),
            (builtins, "exec"),
            (builtins, "compile"),
            (sympy, "sympify"),
            (sympy, "S"),
            (sympy, "lambdify"),
            (sympy, "parse_expr"),
            (parser, "parse_expr"),
            (parser, "eval_expr"),
        ]:
            patch.setattr(module, name, _evaluator)
        patch.setattr(core, "sympify", refuse_text)
        yield


def test_the_breakage_works() -> None:
    with _broken_evaluators():
        for name in ("eval", "exec", "compile"):
            with pytest.raises(AssertionError, match="an evaluator was called"):
                getattr(builtins, name)("1")
        with pytest.raises(AssertionError):
            importlib.import_module("sympy.core.sympify").sympify("1")


def test_parsing_and_printing_need_no_evaluator() -> None:
    with _broken_evaluators():
        for text, with_parentheses in PRECEDENCE:
            assert parse(format_tree(parse(text))) == parse(with_parentheses)
        for text, _ in REFUSED:
            with pytest.raises(FormulaError):
                parse(text)


def _build_everything() -> None:
    gamma = np.array([0.3, 0.5, 0.7])
    for text in POTENTIALS:
        potential = expression_potential(text, {"a": Fraction(-1)}, BODY)
        real = float(potential.value(gamma))
        ball = potential.value_ball(arb("0.3"), arb("0.5"), arb("0.7"))
        # Ten roundings, of terms that reach a hundred times the sum.
        assert abs(real - float(ball)) < 1e-13 * (1 + abs(real))
        assert isinstance(sympy_expression(potential.tape), sympy.Expr)


def test_building_functions_and_expressions_needs_no_evaluator() -> None:
    # Once before: SymPy imports some of its modules when first needed, and imports use exec.
    _build_everything()
    with _broken_evaluators():
        _build_everything()


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')",
        "().__class__.__bases__[0]",
        "lambda: 0",
        "g1.__class__",
        "exec('1')",
        "eval(g1)",
        "Symbol('x')",
        "g1 if g2 else g3",
        "[x for x in g1]",
        "f'{g1}'",
        "factorial(100000)",
        "g1;import os",
        "S(1)",
        "oo",
        "I*g1",
        "E",
        "zoo",
        "__builtins__",
    ],
)
def test_python_and_sympy_mean_nothing_here(text: str) -> None:
    with _broken_evaluators(), pytest.raises(DynamicsError) as caught:
        expression_potential(text, {}, BODY)
    assert isinstance(caught.value, FormulaError)
    assert caught.value.position is not None
    assert caught.value.pointer == "/potential/expression"


def test_reading_a_potential_does_not_import_sympy() -> None:
    # SymPy takes a third of a second to import; only what compares expressions needs it.
    code = "import sys, service.dynamics.potentials.families.written; sys.exit('sympy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False, timeout=60).returncode == 0
