import numpy as np
import pytest

from armguard.bounds.planned.findings import FINE, PLACE, WORDS, Finding, describe

JOINTS = ["shoulder", "elbow"]


@pytest.mark.parametrize("kind", sorted(WORDS))
def test_each_finding_names_its_joint_and_says_what_was_found(kind):
    assert kind != FINE
    for found in (0.25, -3.5e9, np.nan, np.inf):
        refusal = describe(Finding(kind, 1, found, -1.0, 1.0, 0.125), JOINTS)
        assert refusal.subject == "elbow"
        assert any(f"{found:{digits}}" in refusal.detail for digits in (".4g", ".6g"))


@pytest.mark.parametrize(
    ("when", "words"), [(0.02, "0.02 s into the plan"), (-0.02, "when it begins, 0.02 s on")]
)
def test_before_a_plan_begins_it_is_said_when_it_does(when, words):
    assert words in describe((PLACE, 0, 0.1, 0.2, 0.05, when), JOINTS).detail
