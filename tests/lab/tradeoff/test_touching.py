import numpy as np

from armguard.lab.tradeoff.figures import count_missed
from armguard.lab.tradeoff.scene import make_scene
from armguard.lab.tradeoff.touching import APPROACH, RATE, STAY, add_touching, find_state
from armguard.lab.tradeoff.truth import TrueArm, find_contacts
from armguard.verdict import Level
from support.tradeoff_cases import make_site, make_track


def test_a_ball_comes_stays_and_goes_within_usual_bounds():
    waits, touched = np.array([1.5, 0.0, 0.5]), np.array([0.2, 0.3, 0.5])
    times = np.arange(-4.0, 4.0, 0.01)
    places, paces = map(
        np.array, zip(*[find_state(time, waits, touched) for time in times], strict=True)
    )
    np.testing.assert_allclose(places[0], waits)
    np.testing.assert_allclose(places[-1], waits, atol=1e-12)
    stays = (times >= 0.0) & (times <= STAY)
    np.testing.assert_allclose(places[stays], np.tile(touched, (stays.sum(), 1)), atol=1e-9)
    # Velocities are those of the places, and both keep to what tables of obstacles assume.
    slope = (places[2:] - places[:-2]) / 0.02
    np.testing.assert_allclose(paces[1:-1], slope, atol=2e-2)
    assert np.linalg.norm(paces, axis=1).max() < 2.0
    assert np.linalg.norm(np.diff(paces, axis=0), axis=1).max() / 0.01 < 10.0


def test_balls_really_touch_the_arm_within_their_bounds():
    site = make_site()
    scene, _ = make_scene(site, None, 1, 6.0, 0)
    told = len(scene.messages)
    assert add_touching(scene, site, 3, 0) == "3 balls that touch it"
    assert len(scene.messages) == told + round(6.0 * RATE) + 1
    stamps = [message.stamp for message in scene.messages]
    assert stamps == sorted(stamps)
    contacts = find_contacts(scene, TrueArm(site.robot, None), 10.0, 2.0)
    touched = {one.body for one in contacts if not one.is_beyond}
    assert touched == {"touching-0", "touching-1", "touching-2"}
    # Each by the time at which it was led there.
    for number in range(3):
        first = next(one for one in contacts if one.body == f"touching-{number}")
        assert first.time <= 6.0 * (number + 1) / 4 + 1e-9
        assert first.time > 6.0 * (number + 1) / 4 - APPROACH


def test_a_control_that_never_says_stop_misses_every_contact():
    site = make_site()
    scene, _ = make_scene(site, None, 1, 6.0, 0)
    add_touching(scene, site, 3, 0)
    contacts = find_contacts(scene, TrueArm(site.robot, None), 10.0, 2.0)
    silent = make_track([Level.CLEAR] * 600, contact_time=np.inf)
    assert count_missed(silent, contacts, 0.023) == len(contacts) >= 3
    stopped = make_track([Level.STOP] * 600, contact_time=0.0)
    assert count_missed(stopped, contacts, 0.023) == 0
