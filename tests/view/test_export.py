import base64
import gzip
import re

import msgspec
import pytest

from armguard.exceptions import ArmguardError
from armguard.view import export as export_module
from armguard.view.drawing import show
from armguard.view.export import check_export, write_export
from armguard.view.page_state import PageState
from armguard.view.server import PAGE
from support.view_samples import make_frame


@pytest.fixture
def page_state():
    page_state = PageState("tcp://127.0.0.1:1")
    page_state.film.clear(is_recording=True)
    for now in (0.0, 1.0, 2.0):
        page_state.film.add(make_frame(now=now), b"")
    return page_state


def draw(number, with_volume):
    return [show("banner", {"sequence": number})]


def test_the_file_holds_page_viewer_and_all_moments_and_asks_for_nothing(page_state, tmp_path):
    path = tmp_path / "scene.html"
    write_export(path, [show("legend", {}).payload], page_state, draw)
    page = path.read_text(encoding="utf-8")
    assert not re.findall(r'(?:src|href)="(?!data:)', page)
    for module in PAGE.glob("*.js"):
        assert f'"armguard/{module.name}": "data:' in page
    packed = re.search(r'id="film" type="text/plain">([^<]*)<', page)[1]
    film = msgspec.msgpack.decode(gzip.decompress(base64.b64decode(packed)))
    assert [kind["type"] for kind in film["scene"]] == ["legend"]
    numbers = [row[0] for row in film["news"]["moments"]]
    assert [number for number, _ in film["moments"]] == numbers
    assert [drawn[0]["sequence"] for _, drawn in film["moments"]] == numbers


def test_nothing_to_show_too_much_and_nowhere_to_write_are_said(page_state, tmp_path, monkeypatch):
    with pytest.raises(ArmguardError, match="no moment"):
        write_export(tmp_path / "a.html", [], PageState("tcp://127.0.0.1:1"), draw)
    with pytest.raises(ArmguardError, match="cannot be written"):
        write_export(tmp_path / "nowhere" / "a.html", [], page_state, draw)
    monkeypatch.setattr(export_module, "MOST_BYTES", 10)
    with pytest.raises(ArmguardError, match="more than"):
        write_export(tmp_path / "a.html", [], page_state, draw)
    check_export(tmp_path / "a.html")
    for place in (tmp_path, tmp_path / "nowhere" / "a.html"):
        with pytest.raises(ArmguardError, match="cannot be written"):
            check_export(place)
