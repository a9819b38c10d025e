import subprocess
import sys

import pytest

import armguard
from armguard.lazy import lazy_names


def test_a_name_is_loaded_once_it_is_asked_for(monkeypatch, tmp_path):
    face = tmp_path / "furnished"
    face.mkdir()
    (face / "__init__.py").write_text(
        "from armguard.lazy import lazy_names\n"
        "__getattr__, __dir__ = lazy_names(\n"
        "    __name__, {'Lamp': 'furnished.lamp', 'lamp': 'furnished.lamp'}\n"
        ")\n"
    )
    (face / "lamp.py").write_text("class Lamp: pass\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    import furnished

    assert "furnished.lamp" not in sys.modules
    assert {"Lamp", "lamp"} <= set(dir(furnished))
    assert furnished.Lamp is furnished.lamp.Lamp
    assert furnished.lamp is sys.modules["furnished.lamp"]
    assert "Lamp" in vars(furnished)  # from now on like any other name
    for name in [name for name in sys.modules if name.startswith("furnished")]:
        monkeypatch.delitem(sys.modules, name)


def test_what_is_not_there_is_an_attribute_error():
    load, _ = lazy_names("armguard", {})
    with pytest.raises(AttributeError, match="module 'armguard' has no attribute 'Robto'"):
        load("Robto")
    with pytest.raises(AttributeError):
        armguard.Robto  # noqa: B018


def test_all_names_can_be_imported_by_star():
    program = "from armguard import *\nprint(Plan.__name__, certificate.__name__, people.__name__)"
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert told.stdout.split() == ["Plan", "armguard.contact.certificate", "armguard.people"]
