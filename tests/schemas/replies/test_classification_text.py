"""The classical cases on which a state lies, as text."""

from service.schemas.replies.text import describe_classification
from service.schemas.replies.verdict import ClassificationOut, IntegrableOut, NearCaseOut

NEAR = NearCaseOut(case="steklov", distance=0.25, is_on=False, relations={"q": 0.1, "g1 - x": None})
LOST = NearCaseOut(case="hess", distance=None, is_on=False, relations={"p": 3.0})
ON = NearCaseOut(case="grioli", distance=0.0, is_on=True, relations={"p": 0.0})
EULER = IntegrableOut(case="euler", holds=False, residuals={"|centre|": 1.0})


def told(**members) -> str:
    given = {"on": [], "nearest": None, "cases": [], "integrable": [], **members}
    return "\n".join(describe_classification(ClassificationOut(**given)))


def test_the_nearest_case_is_told_with_what_each_relation_leaves():
    text = told(nearest=NEAR, cases=[NEAR, LOST], integrable=[EULER])
    assert "lies on     no classical or integrable case" in text
    assert "nearest     steklov: at most 0.25 away" in text
    assert "q: 0.1" in text
    assert "g1 - x: no value here" in text
    assert "also        hess: Newton's steps from the state lead nowhere" in text
    assert text.count("steklov") == 1
    assert "integrable  euler does not hold: |centre| 1" in text


def test_the_cases_that_a_state_lies_on_are_named():
    text = told(
        on=["grioli", "euler"], nearest=ON, cases=[ON], integrable=[EULER.model_copy(update={"holds": True})]
    )
    assert "lies on     grioli, euler" in text
    assert "nearest     grioli: the state lies on it" in text
    assert "euler holds" in text


def test_a_body_without_cases_has_no_nearest_one():
    assert told() == "lies on     no classical or integrable case"
