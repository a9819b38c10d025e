"""What a user finds in `armguard` after nothing but `import armguard`."""

import armguard


def test_every_public_name_is_there():
    for name in armguard.__all__:
        assert getattr(armguard, name) is not None
    assert armguard.__all__ == sorted(armguard.__all__)


def test_rooms_that_users_meet_come_with_the_package():
    assert armguard.people.BOUNDS["hand"].speed > armguard.people.BOUNDS["trunk"].speed
    assert armguard.bounds.JointMotion
    assert armguard.contact.earliest_contact_pair
