"""The types against those of `rosbags`, which has read the packages of ROS 2 itself."""

import pytest
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from armguard.bridges.messages import JOINTS, OBSTACLES
from armguard.bridges.ros2 import DIAGNOSTICS, SPEED
from armguard.bridges.ros2_types import FIELDS
from support.bags_made import STORE


def name_kind(described):
    """Type and length as the module has them."""
    node, detail = described
    if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        kind, length = detail
        return name_kind(kind)[0], length
    name = detail[0] if node is Nodetype.BASE else detail
    return "byte" if name == "octet" else name, None


@pytest.mark.parametrize("store", [STORE, get_typestore(Stores.ROS2_JAZZY)])
def test_types_are_those_of_the_packages(store):
    known = [name for name in FIELDS if name in store.fielddefs]
    assert len(known) > 20
    for name in known:
        expected = [(field, *name_kind(kind)) for field, kind in store.fielddefs[name][1]]
        assert [(one.name, one.kind, one.length) for one in FIELDS[name]] == expected, name


def test_each_type_stands_behind_those_that_it_is_made_of():
    seen = set()
    for name, fields in FIELDS.items():
        assert {one.kind for one in fields if "/" in one.kind} <= seen
        seen.add(name)
    assert seen >= {JOINTS, DIAGNOSTICS, SPEED, *OBSTACLES}
