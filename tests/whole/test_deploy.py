"""The unit file in docs/deploy.md is one that systemd can read and armguard can be started by."""

import configparser
import re
import shlex
from pathlib import Path

from armguard.app.cli import _parse
from armguard.app.realtime import PRIORITY

PAGE = (Path(__file__).parents[2] / "docs" / "deploy.md").read_text(encoding="utf-8")


def read_unit():
    (text,) = re.findall(r"^```ini\n(.*?)^```$", PAGE, flags=re.MULTILINE | re.DOTALL)
    unit = configparser.ConfigParser(interpolation=None)
    unit.optionxform = str
    unit.read_string(text)
    return unit


def test_the_unit_starts_a_run_with_options_that_there_are():
    program, *arguments = shlex.split(read_unit()["Service"]["ExecStart"])
    assert program.endswith("/armguard")
    command = _parse(arguments)
    assert type(command).__name__ == "Run"
    assert {command.obstacles, command.joints, command.verdicts}.isdisjoint({None})
    assert str(command.record) == "/var/lib/armguard"


def test_the_unit_grants_what_a_run_asks_for():
    service = read_unit()["Service"]
    assert service["Type"] == "notify"
    assert int(service["LimitRTPRIO"]) == PRIORITY
    assert service["LimitMEMLOCK"] == "infinity"
    assert float(service["WatchdogSec"]) > 0.0
