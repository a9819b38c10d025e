import json
import math

import armguard_check.proof
from armguard.messages.proof import Proof, TrustedCover, seal, spell_numbers
from armguard.recording.json_form import read_json, write_json
from support.recorded_messages import VERDICT_PROOF


def test_the_digest_is_that_of_the_checker():
    cover = TrustedCover(
        digest="", link="hand", carrier=2, reach=[0.1, math.inf, -0.0, 1e-300], parents=[-1],
        balls=[],
    )  # fmt: skip
    seal(cover)
    names = ("digest", "link", "carrier", "reach", "parents", "balls")
    plain = json.loads(json.dumps(spell_numbers({key: getattr(cover, key) for key in names})))
    assert plain["digest"] == armguard_check.proof.digest(plain)
    plain["reach"][0] = math.nextafter(0.1, 1.0)
    assert plain["digest"] != armguard_check.proof.digest(plain)


def test_a_recording_holds_it_as_the_checker_reads_it():
    recorded, line = json.loads(write_json(VERDICT_PROOF)), json.loads(VERDICT_PROOF.to_json())
    assert recorded == line
    assert recorded["arm"]["digest"] == armguard_check.proof.digest(recorded["arm"])
    assert again(VERDICT_PROOF) == recorded


def again(proof):
    return json.loads(write_json(read_json(Proof, write_json(proof))))


def test_what_json_has_no_number_for_is_spelled():
    data = {"a": [math.inf, -math.inf, 1.0], "b": {"c": math.nan}, "d": "text"}
    spelled = {"a": ["Infinity", "-Infinity", 1.0], "b": {"c": "NaN"}, "d": "text"}
    assert spell_numbers(data) == spelled
