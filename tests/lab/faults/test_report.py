import numpy as np

from armguard.lab.faults.campaign import CampaignReport, Replayed
from armguard.lab.faults.catalogue import Fault
from armguard.lab.faults.outcome import Outcome
from armguard.lab.faults.report import COLUMNS, describe, draw_table, list_cells, write_page
from armguard.lab.faults.truth import Closest

FAULT = Fault("dropout", "camera", "disturb", ("SOURCE_SILENT",))
OBEYING, IGNORING = Closest(0, 0.4, 0.5), Closest(1, 0, 1)
GOOD = Outcome(FAULT, 0.3004, "STOP", "silent | a camera", 0.01, 1, (), OBEYING, IGNORING, 0)
BAD = GOOD._replace(
    fault=FAULT._replace(name="swap"), detected=None, obeying=Closest(2, -0.01, 0.5), missing=3
)
REPLAYED = Replayed("a.mcap", 1000, True, False, 0)


def make(*outcomes, replayed=REPLAYED):
    contacts = sum(one.obeying.contacts for one in outcomes)
    return CampaignReport(list(outcomes), [replayed], Closest(contacts, 0.4, 0.5), 90.0)


def test_a_campaign_passes_only_if_all_is_as_it_must_be():
    assert make(GOOD).passed
    assert not make(GOOD, BAD).passed
    assert not make(GOOD, replayed=REPLAYED._replace(identical=False)).passed


def test_a_row_says_what_was_found():
    assert list_cells(GOOD) == [
        "dropout", "300", "STOP", "silent / a camera", "10 (1 reset)", "nothing", "400", "hit", "0",
    ]  # fmt: skip
    foreign = GOOD._replace(foreign=("gap in joint states",))
    assert list_cells(foreign)[4] == "10 (1 reset; no sign of it: gap in joint states)"
    cells = dict(zip(COLUMNS, list_cells(BAD), strict=True))
    assert (cells["detected [ms]"], cells["contacts"], cells["lost"]) == ("**no**", "**2**", "3")
    covered = list_cells(GOOD._replace(fault=FAULT._replace(signs=()), detected=None))
    assert covered[1:4] == ["–", "STOP", "none needed"]


def test_the_page_has_a_row_a_group_and_names_what_is_wrong():
    struck = GOOD._replace(fault=FAULT._replace(act="kill"))
    page = write_page(make(GOOD, BAD, struck), "page.csv")
    rows = [line for line in page.splitlines() if line.startswith("| ")]
    assert rows[1:] == [
        "| messages dropped | 2 | **no** | 2 |",
        "| processes and disks | 1 | 300 | 0 |",
    ]
    assert "(page.csv)" in page
    assert "swap: not detected" in page
    assert "3 faults in 1.5 minutes" in page
    assert "1,000 verdicts replays bit-identically, nothing lost" in page
    assert "Not as it must be" not in write_page(make(GOOD), "page.csv")
    replayed = REPLAYED._replace(identical=False, cut_off=True)
    torn = write_page(make(GOOD, replayed=replayed), "page.csv")
    assert "does not replay identically" in torn
    assert draw_table(make(GOOD, BAD)).row_count == 2


def test_what_could_not_be_tried_is_told_apart_from_what_is_wrong():
    untried = GOOD._replace(
        fault=FAULT._replace(name="crowd"), obeying=Closest(0, np.inf, 0.0), was_tried=False
    )
    assert make(GOOD, untried).passed
    assert not make(untried).passed, "then nothing was shown"
    assert list_cells(untried)[3] == "could not be tried on this machine"
    page = write_page(make(GOOD, untried), "page.csv")
    assert "hit in **1 of 1** faults.\n- Could not be tried on this machine: crowd." in page
    assert "Not as it must be" not in page


def test_the_object_has_all_of_it():
    told = describe(make(GOOD, BAD))
    assert (told["passed"], told["contacts"], told["distance"]) == (False, 2, 0.4)
    assert [row["problem"] for row in told["faults"]] == ["", "not detected"]
    assert [row["fault"] for row in told["faults"]] == ["dropout", "swap"]
    assert told["recordings"][0].identical
