"""Over HTTP too it is said for which λ there are motions where there is none."""

import pytest

from tests.support.api import PLANAR

pytestmark = pytest.mark.any_database

REPELS = {"type": "gravity", "a": 1}
NOWHERE = {"lambda": [], "nu": None, "undecided": []}


def test_a_validation_says_where_motions_are(client):
    question = {"body": PLANAR["body"], "potential": REPELS, "motion": PLANAR["motion"]}
    answer = client.post("/v1/validations", json=question).json()
    assert answer["motions"] == []
    assert answer["existence"] == NOWHERE


def test_the_refusal_of_a_job_says_it_too(client):
    response = client.post("/v1/jobs", json={**PLANAR, "potential": REPELS})
    assert response.status_code == 422
    assert response.json()["existence"] == NOWHERE
    assert response.json()["detail"].endswith("; there is none for any lambda")
