import pytest

from armguard.exceptions import ArmguardError
from armguard.view.listening import LOOPBACK, listen


def test_it_listens_on_the_loopback_interface_only():
    with listen(0) as listener:
        address, port = listener.getsockname()
        assert address == LOOPBACK == "127.0.0.1"
        assert port > 0
        assert not listener.getblocking()


def test_a_port_in_use_is_named_and_free_once_it_is_closed():
    with listen(0) as listener:
        port = listener.getsockname()[1]
        with pytest.raises(ArmguardError, match=f"port {port} .*in use"):
            listen(port)
    listen(port).close()


@pytest.mark.parametrize("port", [-1, 65_536, 2**32 + 8080, 10**12])
def test_no_number_is_wrapped_around_to_a_port(port):
    with pytest.raises(ArmguardError, match="no such port"):
        listen(port)
