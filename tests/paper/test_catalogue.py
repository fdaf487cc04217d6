"""The catalogue, the tests and docs/paper.md are in step."""

from collections import Counter

from tests.paper.catalogue import CATALOGUE, DOCUMENT, FOLDER, files_of_tests, render


def test_every_record_names_tests_and_every_test_has_a_record():
    named = {name for record in CATALOGUE for name in record.proof}
    assert named == set(files_of_tests())
    assert all(record.proof for record in CATALOGUE)


def test_names_of_tests_are_unique_in_the_folder():
    total = sum(
        path.read_text(encoding="utf-8").count("\ndef test_") for path in FOLDER.glob("test_[1-5]_*.py")
    )
    assert total == len(files_of_tests())


def test_every_numbered_equation_is_there_and_in_order():
    numbers = [record.number for record in CATALOGUE if record.number is not None]
    assert sorted(set(numbers)) == list(range(1, 39))
    places = Counter(record.place for record in CATALOGUE)
    assert max(places.values()) == 1


def test_every_erratum_says_what_is_correct():
    assert all(record.correct for record in CATALOGUE if record.status != "verified")


def test_formulas_survive_a_table_of_markdown():
    for record in CATALOGUE:
        for text in (record.place, record.printed, record.correct):
            assert text.count("$") % 2 == 0
            assert not any(sign in text for sign in ("|", "\n", "\\,", "\\{", "\\;", "\\_", "\\!", "\\|"))


def test_the_document_is_what_the_catalogue_renders():
    assert DOCUMENT.read_text(encoding="utf-8") == render()
