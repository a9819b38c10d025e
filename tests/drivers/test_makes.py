"""Each make of robot that a cell file can name."""

import subprocess
import sys
import typing

import pytest

from armguard.app.cell.schema import DriverTable
from armguard.drivers.makes import find_make

NAMES = typing.get_args(typing.get_type_hints(DriverTable)["name"])


@pytest.mark.parametrize("name", NAMES)
def test_a_make_is_found_by_its_name_without_its_client_library(name):
    make = find_make(name)
    assert 0.0 < make.rates[0] <= make.rates[1]
    assert all(len(set(names)) == len(names) > 0 for names in make.joints)
    code = f"""
import sys
from armguard.drivers.makes import find_make
make = find_make({name!r})
assert make.library not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], check=True)
