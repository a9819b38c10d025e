from armguard.drivers.moment import Conduct, Moment
from armguard.drivers.motion import MotionConduct
from armguard.drivers.program import ProgramConduct


def test_both_conducts_act_on_a_moment():
    for kind in (ProgramConduct, MotionConduct):
        assert {name for name in vars(Conduct) if not name.startswith("_")} <= set(vars(kind))
    assert "hindrance" in Moment._fields
