import random
import re
import sys
from functools import lru_cache

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.dynamics.errors import FormulaError, FormulaLimitError
from service.dynamics.formula.parser import parse, parse_located
from service.dynamics.formula.tree import MAX_CHARACTERS, MAX_DEPTH, MAX_TOKENS, format_tree, post_order
from tests.support.effort import examples
from tests.support.formulas import PRECEDENCE, REFUSED

PIECES = [
    *"0123456789.eE+-*/^()()  \n",
    *["g1", "g2", "g3", "pi", "A", "a", "sqrt", "sqrt(", "exp(", "sin(", "**", "1e", "0.5", "((", "))"],
]


@pytest.mark.parametrize(("text", "with_parentheses"), PRECEDENCE)
def test_operators_bind_as_in_books(text: str, with_parentheses: str) -> None:
    assert parse(text) == parse(with_parentheses)


@pytest.mark.parametrize(("text", "position"), REFUSED)
def test_the_position_is_that_of_the_fault(text: str, position: int) -> None:
    with pytest.raises(FormulaError) as caught:
        parse(text)
    assert caught.value.position == position
    assert caught.value.message.startswith(f"character {position + 1}: ")
    assert caught.value.code == "formula"


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("+g1", "g1"),
        ("+ +g1", "g1"),
        ("a*+g1", "a*g1"),
        ("g2^+2", "g2^2"),
        ("-+g1", "-g1"),
        ("+g1^2", "g1^2"),
    ],
)
def test_the_sign_plus_changes_nothing(text: str, same: str) -> None:
    assert parse(text) == parse(same)
    located = parse_located(text)
    assert len(located.positions) == len(post_order(located.tree))


@pytest.mark.parametrize(
    ("character", "name", "written"),
    [
        ("\u2212", "minus sign", "write -"),
        ("\u00b7", "middle dot", "write *"),
        ("\u00b2", "superscript two", "write ^2"),
        ("\u03c0", "greek small letter pi", "write pi"),
        ("\u00a0", "no-break space", "write a blank"),
        ("\u200b", "zero width space", "write nothing"),
    ],
)
def test_a_character_from_a_page_is_named_with_what_is_written_for_it(
    character: str, name: str, written: str
) -> None:
    with pytest.raises(FormulaError) as caught:
        parse(f"g1{character}")
    assert f"(U+{ord(character):04X}, {name})" in caught.value.message
    assert written in caught.value.message
    assert caught.value.position == 2


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("γ₁ + k", "g1 + k"),
        ("γ_1·γ_{3}²", "g1*g3^2"),
        ("2g1 (g1+g3)", "2*g1*(g1+g3)"),
        ("a(g1 + 1)", "a*(g1 + 1)"),
        (r"\frac{a}{g3^2} - \gamma_{1}\cdot\sqrt{g3}", "(a)/(g3^2) - g1*sqrt(g3)"),
        ("1,5*g1", "1.5*g1"),
        ("a*[g1 − 1]", "a*(g1 - 1)"),
    ],
)
def test_a_slip_is_answered_with_what_was_meant(text: str, meant: str) -> None:
    with pytest.raises(FormulaError, match=re.escape(f"did you mean {meant!r}?")):
        parse(text)
    parse(meant)


@pytest.mark.parametrize("text", ["", "g1 +", "(g1", "g1)", "sin g1", "x = g1", "((", "2g1" * 100])
def test_what_is_not_to_be_guessed_is_not(text: str) -> None:
    with pytest.raises(FormulaError) as caught:
        parse(text)
    assert "did you mean" not in caught.value.message


def test_every_node_knows_its_place() -> None:
    text = "a*sin(b - 2)^-c"
    located = parse_located(text)
    assert len(located.positions) == len(post_order(located.tree))
    assert [text[p] for p in located.positions] == list("ab2-sc-^*")


@pytest.mark.parametrize(
    "text",
    [
        "1" * (MAX_CHARACTERS + 1),
        "+".join(["1"] * (MAX_TOKENS // 2 + 1)),
        "(" * (MAX_DEPTH + 1) + "1" + ")" * (MAX_DEPTH + 1),
        "sin(" * (MAX_DEPTH + 1) + "1" + ")" * (MAX_DEPTH + 1),
        "-" * (MAX_DEPTH + 1) + "1",
        "^".join(["2"] * (MAX_DEPTH + 2)),
        "(a+b*" * (MAX_DEPTH + 1) + "1" + ")" * (MAX_DEPTH + 1),
    ],
)
def test_what_is_too_large_is_refused_with_its_place(text: str) -> None:
    with pytest.raises(FormulaLimitError) as caught:
        parse(text)
    assert caught.value.position is not None


@pytest.mark.parametrize("opening", ["(", "-", "2^", "sin(", "(a+b*", "a+b*-(", "a*b^("])
def test_the_deepest_formula_needs_less_than_half_of_the_recursion_limit(opening: str) -> None:
    # A server's own frames and a test runner's take up to 200.
    per_level = sum(opening.count(mark) for mark in "(-^") if opening != "sin(" else 1
    levels = MAX_DEPTH // per_level
    text = opening * levels + "1" + ")" * (levels * opening.count("("))
    limit = sys.getrecursionlimit()
    frame, depth = sys._getframe(), 0
    while frame.f_back is not None:
        frame, depth = frame.f_back, depth + 1
    sys.setrecursionlimit(depth + 500)
    try:
        tree = parse(text)
    finally:
        sys.setrecursionlimit(limit)
    assert parse(format_tree(tree)) == tree


def test_flat_sums_and_products_may_be_long() -> None:
    for operator in "+-*/":
        text = operator.join(["g1"] * 1250)
        printed = format_tree(parse(text))
        assert printed.replace(" ", "") == text


def _fault(text: str) -> FormulaError | None:
    try:
        parse(text)
    except FormulaError as error:
        return error
    return None


CALLS_PER_CHARACTER = 25
"""Calls of functions, Python's own among them: a parser that looks back makes more for each in longer
texts."""


@lru_cache
def _made_once() -> None:
    """Let the parser make what it makes at its first refusals: patterns of slips."""
    for text in ("", "2g1", r"\frac{a}{b}", "1,5*g1", "γ₁·g2", "k", "[g1]"):
        _fault(text)


def _refused_or_parsed_in_few_steps(text: str) -> None:
    _made_once()
    calls = 0

    def count(frame: object, event: str, argument: object) -> None:
        nonlocal calls
        calls += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(count)
    try:
        fault = _fault(text)
    finally:
        sys.setprofile(before)
    assert fault is None or fault.position is not None
    assert calls <= CALLS_PER_CHARACTER * (len(text) + 100)


@settings(deadline=None)
@given(st.text(max_size=300))
def test_any_text_is_a_formula_or_refused_with_a_place(text: str) -> None:
    _refused_or_parsed_in_few_steps(text)


@settings(deadline=None, max_examples=examples(33, 200))
@given(st.integers(0, 2**32), st.integers(0, 10_000), st.sampled_from(["ascii", "unicode", "pieces"]))
def test_ten_thousand_random_characters_take_few_steps(seed: int, length: int, kind: str) -> None:
    source = random.Random(seed)
    if kind == "pieces":
        text = "".join(source.choices(PIECES, k=length))[:length]
    else:
        top = 127 if kind == "ascii" else 0xD7FF
        text = "".join(chr(source.randint(0, top)) for _ in range(length))
    _refused_or_parsed_in_few_steps(text)


@pytest.mark.one_in(4)
@pytest.mark.parametrize(
    "piece",
    ["1", "1.", "(", ")", "-", "2^", "1e", "1e1", "e", "g1+", "sin(", "**", "*", " ", "1/3-", ".", "9e400*"],
)
def test_repetition_does_not_slow_the_parser(piece: str) -> None:
    for length in (MAX_CHARACTERS, 10_000):
        text = (piece * length)[:length]
        _refused_or_parsed_in_few_steps(text)
        _refused_or_parsed_in_few_steps(text[:-1] + "1")
