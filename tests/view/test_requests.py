import pytest

from armguard.exceptions import ArmguardError
from armguard.view.requests import LONGEST, Done, Layers, ResetRequest, Seek, read_request


@pytest.mark.parametrize(
    ("line", "request_"),
    [
        ('{"type": "done"}', Done()),
        ('{"type": "seek", "number": 12}', Seek(12)),
        ('{"type": "seek", "number": null}', Seek(None)),
        ('{"type": "layers", "volume": true}', Layers(True)),
        ('{"type": "reset", "token": "sesame"}', ResetRequest("sesame")),
    ],
)
def test_what_a_page_may_say_is_read(line, request_):
    assert read_request(line) == request_


@pytest.mark.parametrize(
    "line",
    [
        "",
        "done",
        b'{"type": "done"}',
        '{"type": "draw"}',
        '{"type": "done", "more": 1}',
        '{"type": "seek"}',
        '{"type": "seek", "number": 1.5}',
        '{"type": "reset", "token": null}',
        '{"type": "reset", "token": "' + LONGEST * "x" + '"}',
        "\ud800",
    ],
)
def test_nothing_else_is(line):
    with pytest.raises(ArmguardError, match="page"):
        read_request(line)
