"""Addresses of both kinds."""

import pytest


@pytest.fixture(params=["ipc", "tcp"])
def address(request, tmp_path):
    return f"ipc://{tmp_path}/in" if request.param == "ipc" else "tcp://127.0.0.1:*"
