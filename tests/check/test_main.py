import json
import subprocess
import sys

import numpy as np

from armguard_check.__main__ import check
from support.proof_scenes import make_proof


def make_line():
    random = np.random.default_rng(4)
    while True:
        proof = make_proof(random, name="panda")
        if proof is not None:
            return json.dumps(proof)


def test_what_was_found_is_told():
    line = make_line()
    found = check([line, line])
    assert (found["proofs"], found["verified"], found["first_refused"]) == (2, 2, None)
    assert list(found["arms"].values()) == [2]
    told = json.loads(line)
    told["motions"] = [one for one in told["motions"] if one["told"] != "never"]
    told["motions"][0]["separations"] = []
    found = check([line, json.dumps(told)])
    assert (found["contact_free"], found["rests_in_time"], found["rests_only"]) == (1, 1, 1)
    for nonsense in ("", "{", "[]", "null", "[" * 100_000):
        found = check([line, nonsense, line])
        assert (found["proofs"], found["verified"]) == (3, 2)
        assert found["first_refused"]["proof"] == 2
        assert found["first_refused"]["why"]


def test_it_runs_by_itself(tmp_path):
    # -I: not even what stands beside it is found by accident; -S: no package that is installed.
    import armguard_check

    folder = tmp_path / "armguard_check"
    folder.symlink_to(armguard_check.__path__[0])
    start = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import runpy; "
    start += "runpy.run_module('armguard_check', run_name='__main__')"
    for lines, code in ((make_line(), 0), ("{}", 1), ("", 1)):
        done = subprocess.run(
            [sys.executable, "-I", "-S", "-c", start],
            input=lines,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == code, done.stderr
        assert json.loads(done.stdout)["verified"] == (code == 0)
