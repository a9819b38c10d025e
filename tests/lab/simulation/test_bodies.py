from itertools import pairwise

import numpy as np

from armguard.lab.simulation import ProceduralPerson
from armguard.lab.simulation.bodies import BODIES, POINTS, publish_person
from support.checking_sink import GrowthSink


def test_what_is_between_two_tracked_points_is_covered():
    person, sink = ProceduralPerson(4), GrowthSink()
    person.publish(sink, 10.0)
    points = dict(zip(POINTS, person.sample(10.0)[0], strict=True))
    shapes = [(sink.last[body.name][1], body.radius) for body in BODIES]
    for start, end in pairwise(["head", "collar", "hip"]):
        check_covered(points[start], points[end], shapes)
    for side in ("left", "right"):
        way = ["collar", f"{side}_shoulder", f"{side}_elbow", f"{side}_hand"]
        for start, end in pairwise(way):
            check_covered(points[start], points[end], shapes)


def check_covered(start, end, shapes):
    """Every point of a bone, and 4 cm of flesh around it, is in some ball or capsule."""
    for share in np.linspace(0.0, 1.0, 21):
        point = start + share * (end - start)
        depth = max(r - distance_to_segment(point, p[0], p[-1]) for p, r in shapes)
        assert depth > 0.04


def distance_to_segment(point, start, end):
    along = end - start
    share = np.clip((point - start) @ along / max(along @ along, 1e-12), 0.0, 1.0)
    return np.linalg.norm(point - start - share * along)


def publish(sink, position, **fields):
    publish_person(sink, "camera", 1.0, position, np.zeros((9, 3)), np.arange(9.0), **fields)


def test_ids_say_whose_bodies_they_are():
    sink = GrowthSink()
    publish(sink, np.zeros((9, 3)), person="anna")
    assert set(sink.last) == {f"anna/{body.name}" for body in BODIES}


def test_a_body_with_a_point_that_was_not_seen_is_left_out():
    for hidden in POINTS:
        sink, position = GrowthSink(), np.zeros((9, 3))
        position[POINTS.index(hidden), 1] = np.nan
        publish(sink, position)
        assert set(sink.last) == {body.name for body in BODIES if hidden not in body.points}


def test_a_body_is_off_by_as_much_as_the_worse_of_its_points():
    sink = GrowthSink()
    publish(sink, np.zeros((9, 3)))
    for body in BODIES:
        assert sink.last[body.name][4] == max(POINTS.index(point) for point in body.points)


def test_a_source_that_sees_nobody_says_that_it_is_alive():
    sink = GrowthSink()
    publish(sink, np.full((9, 3), np.nan))
    assert [(call[0], call[1], call[4]) for call in sink.calls] == [([], 1.0, "camera")]
