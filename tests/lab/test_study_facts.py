from armguard.lab.study_facts import list_facts


def test_a_page_names_machine_versions_and_seed():
    facts = list_facts(3)
    assert set(facts) == {"machine", "versions", "seed"}
    assert facts["seed"] == "3"
    assert "numba" in facts["versions"]
    assert set(list_facts()) == {"machine", "versions"}
