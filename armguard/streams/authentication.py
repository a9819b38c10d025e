"""Who may connect, and who may send what: CURVE keys, checked for each connection.

ZeroMQ asks by its own protocol (ZAP, RFC 27) whether the key of a client is a known one, and keeps
the name that it is answered with each message that comes over that connection. The answers are
given by the sockets' own loop, a few at a time: no thread, no lock, and strangers that connect
again and again cost a tick no more than that.
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
"""What a client may do: send obstacles in its own name; send joint states, plans, goals and wishes
that contact be wanted; read verdicts and commands; end a latched STOP; attach a view."""

RIGHTS: tuple[Right, ...] = get_args(Right)

INPUT_RIGHTS: tuple[Right, ...] = ("obstacles", "joints", "reset")
"""Each of these opens an input."""

_ANSWERS_A_TIME = 8
"""Handshakes that one call of `answer` answers at most; others wait for the next."""

_ENDPOINT = "inproc://zeromq.zap.01"
_VERSION = b"1.0"
_KEY_BYTES = 32


class Client(NamedTuple):
    """One that may connect."""

    public: str
    """Its key, in Z85."""
    may: frozenset[Right]
    arms: frozenset[str] = frozenset()
    """In a cell with several, the arms that it speaks for."""


class ClientError(MessageError):
    """A client that asked to be let in, and was not."""

    kind = "client refused"


class SenderError(MessageError):
    """A message that the client whose key it came with may not send."""

    kind = "sender refused"


class Authenticator:
    """Lets in the clients that are known, and no others; for the sockets that a monitor binds.

    Args:
        keys: The monitor's own.
        clients: By name. A client speaks of obstacles as the source of that name and no other.

    Raises:
        StreamError: A key is none, or two clients have the same.
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
                    expected="keys of its own for each client, by which they are told apart",
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
        """Have a socket of `context` let in only clients that have one of these rights.

        To be called before it binds.
        """
        socket.set(zmq.CURVE_SERVER, 1)
        socket.set(zmq.CURVE_SECRETKEY, self._keys.secret.encode())
        socket.set_string(zmq.ZAP_DOMAIN, ",".join(rights))

    def may(self, name: str, right: Right) -> bool:
        """Whether a client is known and has a right."""
        client = self.clients.get(name)
        return client is not None and right in client.may

    def may_speak_for(self, name: str, arm: str) -> bool:
        """Whether a client is known and speaks for an arm; where there is one, it has no name."""
        client = self.clients.get(name)
        return client is not None and (not arm or arm in client.arms)

    def answer(self) -> None:
        """Answer the handshakes that wait, a few of them; never blocks."""
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
        """Who was refused since the last call: of each name the last one, and how many they were.

        All keys that are not known have one name together.
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
        """Let no more clients in, and close the sockets that this has guarded."""
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
