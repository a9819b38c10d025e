"""Access to the page: for this machine, or from other machines with the token of this start.

On the loopback interface, requests must name this machine or the address that the view listens on.
This prevents DNS rebinding: a foreign page cannot reach the view by a name that resolves to this
machine. On any other interface, requests must carry a token. It is part of the page's URL, which is
printed at the start of the view, and the browser returns it as a cookie. The token is not encrypted
on the network; use a tunnel on networks that you do not trust.
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import socket
from urllib.parse import urlsplit

import tornado.web

from armguard.exceptions import ArmguardError
from armguard.view.listening import LOOPBACK

_LOCAL_NAMES = ("127.0.0.1", "localhost", "::1")
_TOKEN_BYTES = 24


class Access:
    """The rule for one start of a view.

    Args:
        host: Address of the interface to listen on.

    Attributes:
        token: Token that requests must carry; empty on the loopback interface.

    Raises:
        ArmguardError: The host is not an address.
    """

    def __init__(self, host: str = LOOPBACK) -> None:
        try:
            address = ipaddress.ip_address(host)
        except ValueError:
            raise ArmguardError(
                "host of the view",
                f"is {host!r}",
                expected="the address of an interface, as 127.0.0.1",
            ) from None
        self._host = host
        self._is_any = address.is_unspecified
        self.token = "" if address.is_loopback else secrets.token_urlsafe(_TOKEN_BYTES)
        self._cookie = ""

    def describe(self, port: int) -> str:
        """The page's address, with the token if there is one, at a TCP port."""
        # Cookies are the same for all ports of a host: each view has one of its own.
        self._cookie = f"armguard-view-{port}"
        host = socket.gethostname() if self._is_any else self._host
        host = f"[{host}]" if ":" in host else host
        return f"http://{host}:{port}/" + (f"?token={self.token}" if self.token else "")

    def check(self, handler: tornado.web.RequestHandler) -> None:
        """Raise HTTPError 403 unless a request may be answered."""
        if self.token:
            asked = handler.get_query_argument("token", "")
            found = asked or handler.get_cookie(self._cookie, "") or ""
            if not hmac.compare_digest(found.encode(), self.token.encode()):
                raise tornado.web.HTTPError(403)
            if asked:
                handler.set_cookie(self._cookie, asked, httponly=True, samesite="Strict")
            return
        try:
            name = urlsplit(f"//{handler.request.host}").hostname or ""
        except ValueError:
            name = ""
        if name not in (*_LOCAL_NAMES, self._host):
            raise tornado.web.HTTPError(403)
