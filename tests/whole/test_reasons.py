import runpy
from pathlib import Path

import pytest

from armguard.verdict import ReasonKind

DOCS = Path(__file__).parents[2] / "docs"


def test_the_page_of_reasons_is_what_its_script_writes():
    script = runpy.run_path(str(DOCS / "make_reasons.py"))
    assert (DOCS / "reasons.md").read_text(encoding="utf-8") == script["write_page"]()


@pytest.mark.parametrize("kind", list(ReasonKind), ids=lambda kind: kind.name)
def test_each_reason_says_what_to_do(kind):
    assert kind.remedy.endswith(".")
    assert len(kind.remedy.split()) > 5
    assert "|" not in kind.text + kind.remedy
    named = f"- **{kind.text}** (`{kind.name.lower()}`): "
    assert named in (DOCS / "reasons.md").read_text(encoding="utf-8")
