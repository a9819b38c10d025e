"""Authenticates clients by CURVE keys, and checks their rights for each message.

ZeroMQ asks by its protocol ZAP (RFC 27) whether the key of a client is known, and attaches the
answered name to each message of that connection. The loop of the sockets answers a few requests at
a time, without thread and lock. So unknown clients that connect repeatedly cost a tick no more than
that.
"""

from __future__ import annotations

import select
from collections.abc import Iterable, Mapping
from typing import Literal, NamedTuple, get_args

import zmq
from zmq.utils import z85

from armguard.exceptions import StreamError
from armguard.messages.incoming import (
    AnyMessage,
    CloudMessage,
    GoalMessage,
    IgnoreMessage,
    JointsMessage,
    MessageError,
    ObstaclesMessage,
    PlanMessage,
    RemoveMessage,
    ResetMessage,
    WatchMessage,
)
from armguard.streams.keys import KeyPair, check_key

Right = Literal["obstacles", "joints", "verdicts", "reset", "view"]
"""Rights of clients: send obstacles as the source of its own name; send joint states, plans, goals
and requests for wanted contact; read verdicts and commands; end a latched STOP; attach a view."""

RIGHTS: tuple[Right, ...] = get_args(Right)

INPUT_RIGHTS: tuple[Right, ...] = ("obstacles", "joints", "reset")
"""Each of these opens an input."""

_ANSWERS_A_TIME = 8
"""Handshakes that one call of `answer` answers at most; others wait for the next."""

_ENDPOINT = "inproc://zeromq.zap.01"
_VERSION = b"1.0"
_KEY_BYTES = 32


class Client(NamedTuple):
    """A client that may connect."""

    public: str
    """Its key, in Z85."""
    may: frozenset[Right]
    arms: frozenset[str] = frozenset()
    """Arms for which it may send, in a cell with several arms."""


class ClientError(MessageError):
    """A client was refused."""

    kind = "client refused"


class SenderError(MessageError):
    """The client of a message has no right to send it."""

    kind = "sender refused"


class Authenticator:
    """Accepts only known clients, on the sockets that a monitor binds.

    Args:
        keys: Keys of the monitor.
        clients: Clients by name. A client can send obstacles only as the source of its own name.

    Raises:
        StreamError: A key is malformed, or two clients have the same key.
    """

    def __init__(self, keys: KeyPair, clients: Mapping[str, Client]) -> None:
        self._keys = keys
        self.clients = dict(clients)
        self._names: dict[str, str] = {}
        for name, client in clients.items():
            if not check_key(client.public):
                raise StreamError(
                    f"public key of {name}",
                    f"is {client.public!r}",
                    expected="the 40 characters that `armguard keys new` printed",
                )
            if client.public in self._names:
                other = self._names[client.public]
                raise StreamError(
                    f"public key of {name}",
                    f"is that of {other}, too",
                    expected="a different key for each client",
                )
            self._names[client.public] = name
        # ZeroMQ has one authority a context: with one of our own, no other socket is asked for.
        self.context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._socket: zmq.Socket[bytes] = self.context.socket(zmq.ROUTER)
        self._socket.set(zmq.LINGER, 0)
        self._socket.bind(_ENDPOINT)
        # Its descriptor tells of what has come since the socket was last found empty.
        self._poll = select.poll()
        self._poll.register(int(self._socket.get(zmq.FD)), select.POLLIN)
        self._is_unread = True
        self._refused: dict[str, tuple[ClientError, int]] = {}

    def guard(self, socket: zmq.Socket[bytes], rights: Iterable[Right]) -> None:
        """Make a socket of `context` accept only clients with one of these rights.

        Must be called before it binds.
        """
        socket.set(zmq.CURVE_SERVER, 1)
        socket.set(zmq.CURVE_SECRETKEY, self._keys.secret.encode())
        socket.set_string(zmq.ZAP_DOMAIN, ",".join(rights))

    def may(self, name: str, right: Right) -> bool:
        """Whether a client is known and has a right."""
        client = self.clients.get(name)
        return client is not None and right in client.may

    def may_speak_for(self, name: str, arm: str) -> bool:
        """Whether a client is known and may send for an arm; a single arm has no name."""
        client = self.clients.get(name)
        return client is not None and (not arm or arm in client.arms)

    def answer(self) -> None:
        """Answer a few of the waiting handshakes; never blocks."""
        if not (self._is_unread or self._poll.poll(0)):
            return
        self._is_unread = True
        for _ in range(_ANSWERS_A_TIME):
            try:
                parts = self._socket.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                self._is_unread = False
                return
            self._socket.send_multipart(self._judge(parts))

    def take_refused(self) -> list[tuple[ClientError, int]]:
        """Clients refused since the last call: the last refusal of each name, and their number.

        All unknown keys share one name.
        """
        if not self._refused:
            return []
        refused, self._refused = self._refused, {}
        return list(refused.values())

    def _judge(self, parts: list[bytes]) -> list[bytes]:
        """The reply to a request of ZeroMQ's: the name of the client, or that it is refused."""
        identity, delimiter, _, request, domain, address, _, mechanism, *credentials = parts
        name = None
        if mechanism == b"CURVE" and len(credentials) == 1 and len(credentials[0]) == _KEY_BYTES:
            key = z85.encode(credentials[0]).decode()
            name = self._admit(key, domain.decode().split(","), address.decode(errors="replace"))
        status = (b"200", b"OK", name.encode(), b"") if name else (b"400", b"not known", b"", b"")
        return [identity, delimiter, _VERSION, request, *status]

    def _admit(self, key: str, rights: list[str], address: str) -> str | None:
        """Name of the client with this key; None, and told later, where it may not come in."""
        name = self._names.get(key)
        if name is None:
            self._refuse(ClientError("key", f"{key!r} (from {address})", "one that is known"))
        elif not any(right in self.clients[name].may for right in rights):
            found, expected = f"{name!r} (from {address})", f"one that may {' or '.join(rights)}"
            self._refuse(ClientError("client", found, expected, name))
            return None
        return name

    def _refuse(self, error: ClientError) -> None:
        """Note a client that is refused: as many names at most as there are clients, and one."""
        _, times = self._refused.get(error.source, (error, 0))
        self._refused[error.source] = error, times + 1

    def close(self) -> None:
        """Accept no more clients, and close the guarded sockets."""
        self.context.destroy(linger=0)

    def __enter__(self) -> Authenticator:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


_OF_ARMS = JointsMessage | PlanMessage | GoalMessage | IgnoreMessage | WatchMessage
"""Messages whose sender must speak for the arm that they name. A reset names an arm, too; who may
send one has a right of its own."""


def check_sender(message: AnyMessage, sender: str | None, authenticator: Authenticator) -> None:
    """Raise SenderError if the key of a message's sender does not entitle to send it.

    Args:
        message: What was sent.
        sender: Client whose key it came with.
        authenticator: Knows what clients may do.
    """
    right: Right = "joints"
    if isinstance(message, ObstaclesMessage | CloudMessage | RemoveMessage):
        right = "obstacles"
    elif isinstance(message, ResetMessage):
        right = "reset"
    if sender is None or not authenticator.may(sender, right):
        found = f"one of {sender!r}, which may not send {right}"
        raise SenderError("message", found, f"a client that may: {right!r}", sender or "unknown")
    if isinstance(message, _OF_ARMS):
        if not authenticator.may_speak_for(sender, message.arm):
            found = f"{message.arm!r} in a message with the key of {sender!r}"
            raise SenderError("arm", found, f"one of the arms of {sender!r}", sender)
    elif not isinstance(message, ResetMessage) and message.source != sender:
        found = f"{message.source!r} in a message with the key of {sender!r}"
        error = SenderError("source", found, repr(sender), sender, message.seq)
        error.hides_obstacles = True
        raise error
