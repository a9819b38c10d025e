"""The page about the wire says what the schemas say."""

import re
from pathlib import Path

import pytest

from armguard.streams.addresses import JOINTS_ADDRESS, OBSTACLES_ADDRESS, VERDICTS_ADDRESS
from armguard.streams.messages import JointsMessage, PlanMessage, PlanVerdictMessage

PAGE = (Path(__file__).parents[2] / "docs" / "wire.md").read_text()


def read_fields(tag):
    """Fields in the table that follows a message, each with whether it is optional."""
    part = PAGE.split(f'"type": "{tag}"', 1)[1]
    table = re.search(r"\| field \|.*?\n\n", part, flags=re.DOTALL)[0]
    rows = re.findall(r"^\| (`.*?) \| (.*?) \|", table, flags=re.MULTILINE)
    return {
        name: "optional" in kind for names, kind in rows for name in re.findall(r"`(\w+)`", names)
    }


@pytest.mark.parametrize("message", [JointsMessage, PlanMessage, PlanVerdictMessage])
def test_each_field_is_told_and_no_other(message):
    told = read_fields(message.__struct_config__.tag)
    fields = message.__struct_fields__
    with_default = fields[len(fields) - len(message.__struct_defaults__) :]
    assert told == {field: field in with_default for field in fields}


def test_addresses_are_the_usual_ones():
    for address in (OBSTACLES_ADDRESS, JOINTS_ADDRESS, VERDICTS_ADDRESS):
        assert f"`{address}`" in PAGE
