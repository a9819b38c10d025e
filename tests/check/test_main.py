import json
import subprocess
import sys

import numpy as np
import pytest

from armguard_check.__main__ import check
from support.proof_scenes import make_proof


def make_line():
    random = np.random.default_rng(4)
    while True:
        proof = make_proof(random, name="panda")
        if proof is not None:
            return json.dumps(proof).encode()


def test_what_was_found_is_told():
    line = make_line()
    found = check([line, line])
    assert (found["proofs"], found["verified"], found["first_refused"]) == (2, 2, None)
    assert list(found["arms"].values()) == list(found["covers"].values()) == [2]
    told = json.loads(line)
    told["motions"] = [one for one in told["motions"] if one["told"] != "never"]
    told["motions"][0]["separations"] = []
    found = check([line, json.dumps(told).encode()])
    assert (found["contact_free"], found["rests_in_time"], found["rests_only"]) == (1, 1, 1)
    for nonsense in (b"", b"{", b"[]", b"null", b"[" * 100_000):
        found = check([line, nonsense, line])
        assert (found["proofs"], found["verified"]) == (3, 2)
        assert found["first_refused"]["proof"] == 2
        assert found["first_refused"]["why"]


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (lambda line: line + b"\xff", "not UTF-8"),
        (lambda line: line.decode().encode("utf-16"), "not UTF-8"),
        (lambda line: line.replace(b'"margin"', b'"margin": 1.0, "margin"'), "is repeated"),
    ],
)
def test_a_line_that_readers_could_read_otherwise_is_refused(spoil, why):
    line = make_line()
    found = check([line, spoil(line)])
    assert (found["proofs"], found["verified"]) == (2, 1)
    assert why in found["first_refused"]["why"]


def test_what_is_refused_is_named_as_far_as_it_is_plain():
    line = json.dumps({"sequence": 3, "now": [[0.0]], "link": "hand"}).encode()
    first = check([line])["first_refused"]
    assert (first["sequence"], first["now"], first["link"]) == (3, None, "hand")


def test_it_runs_by_itself(tmp_path):
    # -I: not even what stands beside it is found by accident; -S: no package that is installed.
    import armguard_check

    folder = tmp_path / "armguard_check"
    folder.symlink_to(armguard_check.__path__[0])
    start = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import runpy; "
    start += "runpy.run_module('armguard_check', run_name='__main__')"
    for lines, code in ((make_line(), 0), (b"{}", 1), (b"", 1), (b"\xff\n", 1)):
        done = subprocess.run(
            [sys.executable, "-I", "-S", "-c", start],
            input=lines,
            capture_output=True,
            check=False,
        )
        assert done.returncode == code, done.stderr
        assert json.loads(done.stdout)["verified"] == (code == 0)
