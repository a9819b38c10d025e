import ast
import contextlib
import copy
import functools
import json
import math
import os
import sys
from pathlib import Path

import numpy as np
import pytest

import armguard_check
from armguard_check import ProofError, verify
from support.false_proofs import KINDS, seal, tamper
from support.proof_scenes import make_proofs

COUNT = int(os.environ.get("ARMGUARD_PROOFS", "45"))
"""Scenes, and changed proofs, that are tried."""


@pytest.fixture(scope="module")
def proofs():
    return list(make_proofs(3, min(COUNT, 45)))


def test_every_proof_of_a_random_scene_holds():
    claims = {"contact": 0, "rest": 0, "slow": 0}
    for proof in make_proofs(0, COUNT):
        proved = verify(proof)
        claims["contact"] += proved.contact_time > 0.0
        claims["rest"] += proved.in_time
        # An arm that is not stopped is proved to stop in time.
        assert proved.in_time or proof["level"] == "STOP"
        claims["slow"] += any(
            (one["ends"] or [0])[-1] < len(motion["times"]) - 1
            for motion in proof["motions"]
            for one in motion["separations"]
        )
    assert min(claims.values()) > COUNT // 20, claims


def test_no_proof_holds_whose_claim_became_false():
    random = np.random.default_rng(1)
    found = dict.fromkeys(KINDS, 0)
    while sum(found.values()) < COUNT or not all(found.values()):
        for proof in make_proofs(int(random.integers(1 << 30)), 15):
            for kind in KINDS:
                changed = tamper(proof, kind, random)
                if changed is None or not changed[1]:
                    continue
                found[kind] += 1
                with pytest.raises(ProofError):
                    verify(changed[0])


def test_what_is_trusted_cannot_be_changed_unnoticed(proofs):
    for part, key in (("arm", "acceleration"), ("cover", "reach")):
        proof = copy.deepcopy(proofs[0])
        proof[part][key][0] += 1e-9
        with pytest.raises(ProofError, match="digest"):
            verify(proof)


def test_each_part_of_the_link_needs_a_separation(proofs):
    tried = 0
    for proof in proofs[:15]:
        for place, motion in enumerate(proof["motions"]):
            for number in range(min(len(motion["separations"]), 2)):
                changed = copy.deepcopy(proof)
                del changed["motions"][place]["separations"][number]
                if changed["motions"][place]["separations"]:
                    tried += 1
                    with pytest.raises(ProofError, match="no separation covers"):
                        verify(changed)
                elif any(one["told"] != "never" for one in changed["motions"]):
                    assert verify(changed) != verify(proof)
                else:
                    with pytest.raises(ProofError, match="claims nothing"):
                        verify(changed)
    assert tried > 0


def test_a_tree_that_is_none_is_refused(proofs):
    for parents in ([], [0], [-1, 5], [1, 0], [-2], [-0.5], [math.nan], [False]):
        proof = copy.deepcopy(proofs[0])
        proof["cover"]["parents"] = parents
        seal(proof["cover"])
        with pytest.raises(ProofError, match="no tree"):
            verify(proof)


NONSENSE = [
    ([], "margin", -1e-9, "margin is -1e-09"),
    ([], "max_speed", -0.1, "max_speed is -0.1"),
    ([], "max_speed", "Infinity", "max_speed is 'Infinity'"),
    ([], "period", -1e-3, "period is -0.001"),
    ([], "latency", -1e-3, "latency is -0.001"),
    ([], "latency", math.nan, "latency is nan"),
    ([], "reaction_time", -1e-3, "reaction_time is -0.001"),
    ([], "now", -1e9, "newer than its tick"),
    ([], "now", math.inf, "now is inf"),
    ([], "stamp", None, "stamp is None"),
    ([], "level", "stop", "level is none of"),
    ([], "link", "another", "cover belongs to another link"),
    ([], "states", [], "no state"),
    (["q"], 0, math.nan, r"q\[0\] is nan"),
    (["v"], 1, True, r"v\[1\] is True"),
    (["states", 0], "radius", -1e-3, "radius is -0.001"),
    (["states", 0], "position_error", -1e-3, "position_error is -0.001"),
    (["states", 0], "velocity_error", -1e-3, "velocity_error is -0.001"),
    (["states", 0], "accel", -1.0, "accel is -1.0"),
    (["states", 0], "speed", math.nan, "speed is nan"),
    (["states", 0], "stamp", math.nan, "stamp of an obstacle is nan"),
    (["states", 0], "points", [], "malformed|no points"),
    (["states", 0, "points"], 0, math.nan, r"points\[0\] is nan"),
    (["cover"], "carrier", -2, "no joint of the arm carries"),
    (["cover"], "carrier", 99, "no joint of the arm carries"),
    (["cover", "reach"], 3, -1e-3, "radius of a ball is -0.001"),
    (["cover", "balls", 0], "radius", -1e-3, "radius of a ball is -0.001"),
    (["cover", "balls", 0, "center"], 0, math.nan, "center of a ball"),
    (["arm"], "position_error", [-1e-3] * 20, "position_error of joint 0 is -0.001"),
    (["motions", 0, "times"], 0, -1e-3, "times of a tube do not increase"),
    (["motions", 0, "times"], 1, -1e-3, "times of a tube do not increase"),
    (["motions", 0, "times"], -1, math.inf, "times.* is inf"),
    (["motions", 0, "high"], 0, math.nan, r"high\[0\] is nan"),
    (["motions", 0], "told", "perhaps", "malformed"),
    (["motions", 0, "separations", 0], "ends", [99], "malformed|are not increasing"),
]


@pytest.mark.parametrize(("path", "key", "value", "why"), NONSENSE)
def test_nonsense_is_refused_by_name(proofs, path, key, value, why):
    changed = copy.deepcopy(next(one for one in proofs if one["cover"]["balls"]))
    # A radius below 0 and an error that makes up for it are no ball.
    changed["states"][0] |= {"radius": 0.1, "position_error": 0.1}
    where = functools.reduce(lambda part, step: part[step], path, changed)
    where[key] = value
    for part in ("arm", "cover"):
        seal(changed[part])
    with pytest.raises(ProofError, match=why):
        verify(changed)


def spoil(value, random):
    """A copy with one entry replaced by nonsense, or left out."""
    value = copy.deepcopy(value)
    where = value
    while True:
        keys = list(where) if isinstance(where, dict) else range(len(where))
        key = keys[int(random.integers(len(keys)))]
        if isinstance(where[key], (dict, list)) and where[key] and random.random() < 0.9:
            where = where[key]
            continue
        nonsense = [None, "NaN", float("nan"), -1e300, 1e300, [], {}, "x", True, -1]
        if random.random() < 0.1:
            del where[key]
        else:
            where[key] = nonsense[int(random.integers(len(nonsense)))]
        return value


def test_nonsense_is_refused_and_never_an_error(proofs):
    random = np.random.default_rng(7)
    for proof in proofs[:6]:
        for _ in range(20):
            changed = spoil(proof, random)
            for part in ("arm", "cover"):
                if isinstance(changed.get(part), dict) and changed[part] != proof[part]:
                    seal(changed[part])
            with contextlib.suppress(ProofError):
                verify(changed)
    for nonsense in ({}, [], None, 3, "proof"):
        with pytest.raises(ProofError, match="malformed"):
            verify(nonsense)


def test_the_checker_stands_by_itself():
    folder = Path(armguard_check.__file__).parent
    for path in folder.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [one.name for one in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                names = [node.module]
            for name in names:
                top = name.split(".")[0]
                assert top == "armguard_check" or top in sys.stdlib_module_names


def backwards(motion, one):
    one["directions"] = [-x for x in one["directions"]]


def too_short(motion, one):
    motion["times"] = [1e-3 * t for t in motion["times"]]


def out_of_order(motion, one):
    motion["times"][3], motion["times"][4] = motion["times"][4], motion["times"][3]


def late(motion, one):
    motion["times"][0] = 0.5 * motion["times"][1]


def ends_early(motion, one):
    one["ends"][-1] -= 1


def ends_twice(motion, one):
    one["ends"].append(one["ends"][-1])
    one["directions"] += one["directions"][-3:]


def beyond_its_end(motion, one):
    one["ends"][-1] += 1


def other_state(motion, one):
    one["state"] = -1


def all_at_rest(motion, one):
    motion["slowest"], one["ends"], one["directions"] = [], [], []


def other_words(motion, one):
    motion["told"] = "never " + motion["told"]


@pytest.mark.parametrize(
    "attack",
    [
        backwards, too_short, out_of_order, late, ends_early, ends_twice, beyond_its_end,
        other_state, all_at_rest, other_words,
    ],
)  # fmt: skip
def test_attacks_are_refused(proofs, attack):
    tried = 0
    for proof in proofs:
        for place, motion in enumerate(proof["motions"]):
            if not (motion["separations"] and motion["separations"][0]["ends"]):
                continue
            is_stop = motion["told"] != "never"
            if (attack is too_short and not is_stop) or (
                attack is all_at_rest and not (is_stop and motion["slowest"])
            ):
                continue
            changed = copy.deepcopy(proof)
            changed["max_speed"] = 0.0 if attack is ends_early else proof["max_speed"]
            attack(changed["motions"][place], changed["motions"][place]["separations"][0])
            tried += 1
            with pytest.raises(ProofError):
                verify(changed)
    assert tried > 1


def test_numbers_survive_json(proofs):
    assert json.loads(json.dumps(proofs[0])) == proofs[0]


def test_who_may_go_on_is_told_by_the_next_verdict(proofs):
    for proof in proofs:
        if len(proof["motions"]) == 2:
            changed = copy.deepcopy(proof)
            changed["level"] = "SLOW" if proof["level"] == "STOP" else "STOP"
            with pytest.raises(ProofError, match="another verdict stops"):
                verify(changed)


def test_no_ball_stands_for_what_the_link_cannot_leave(proofs):
    for proof in proofs[:12]:
        balls = proof["cover"]["balls"]
        if balls:
            changed = copy.deepcopy(proof)
            changed["cover"]["balls"].append(balls[0] | {"node": -1, "radius": 0.0})
            seal(changed["cover"])
            assert verify(changed)[:4] == verify(proof)[:4]


def test_a_proof_without_a_claim_is_refused(proofs):
    for proof in proofs:
        changed = copy.deepcopy(proof)
        for motion in changed["motions"]:
            motion["separations"] = []
        if any(motion["told"] != "never" for motion in changed["motions"]):
            assert verify(changed)[:3] == (0.0, True, False)
        for motions in ([], [one for one in changed["motions"] if one["told"] == "never"]):
            with pytest.raises(ProofError, match="claims nothing"):
                verify(changed | {"motions": motions})
