"""Every reference that a docstring cites is in the one list, and each key is there once."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
LISTED = re.findall(
    r"^- \*\*\[(\w+)\]\*\*",
    (ROOT / "docs" / "references.md").read_text(encoding="utf-8"),
    flags=re.MULTILINE,
)


def read_citations():
    """Keys by the files that cite them, as `[Key]_`."""
    cited = {}
    for folder in ("armguard", "demos", "benchmarks"):
        for path in (ROOT / folder).rglob("*.py"):
            for key in re.findall(r"\[([A-Z]\w*)\]_", path.read_text(encoding="utf-8")):
                cited.setdefault(key, []).append(str(path.relative_to(ROOT)))
    return cited


def test_every_citation_is_listed():
    cited = read_citations()
    assert "Awareness" in cited
    missing = {key: files for key, files in cited.items() if key not in LISTED}
    assert not missing, f"add to docs/references.md: {missing}"


def test_keys_are_sorted_and_unique():
    assert sorted(set(LISTED)) == LISTED
