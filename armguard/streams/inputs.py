"""Inputs of messages: a bound ZeroMQ socket, or lines of JSON on a file descriptor.

An input never blocks. `receive` returns one message, or None if there is none. Data that cannot be
a message (too long, in several parts) raise `MessageError`, which the edge counts.

An unsuccessful attempt to receive costs as much as a successful one, and most inputs are empty in
most ticks. So `InputWatch` polls all of them with one system call. ZeroMQ's descriptors are
edge-triggered: they report only data that arrived since a socket was last found empty. So a socket
that was not found empty counts as readable, whatever its descriptor reports.
"""

from __future__ import annotations

import itertools
import os
import select
import socket
import struct
from collections.abc import Sequence
from typing import Protocol

import zmq

from armguard.exceptions import StreamError
from armguard.messages.incoming import MessageError
from armguard.streams.addresses import check_address, check_free, explain, remove_file
from armguard.streams.authentication import INPUT_RIGHTS, Authenticator
from armguard.streams.faults import FaultLog

BYTE_LIMIT = 4 * 1024 * 1024
"""Longest message taken: 10,000 boxes with velocities, packed, are 3.9 MB."""

FRAME_LIMIT = BYTE_LIMIT + BYTE_LIMIT // 4
"""Longest message that ZeroMQ makes room for. A longer one ends its sender's connection; between
the two limits a message is dropped, and told by its length."""

QUEUE_LIMIT = 4000
"""Messages that wait at their sender while the loop is busy: forty seconds of a 100 Hz source, four
of joints."""

WAITING_BYTES = 256 * 1024 * 1024
"""Most memory, in bytes, for what waits in an input, of each connection."""

_numbers = itertools.count()
"""Of inputs so far: an address within this process may be in use for a while after its input was
closed."""

_WAITING_MESSAGES = WAITING_BYTES // FRAME_LIMIT
"""Messages that wait in an input, of each connection: nearly as many as a tick takes. With more,
ZeroMQ stops reading, and they wait at their sender; none is lost before its queue is full too."""


CONNECTION_LIMIT = 64
"""Most connections of one input, so that what waits in all of them is bounded."""

_BLANK_LINES = 1024
"""Most blank lines that are taken at once."""

# Flags of an enumeration are looked up, and combined, a hundred times slower than numbers.
_NOBLOCK, _POLLIN = int(zmq.NOBLOCK), int(zmq.POLLIN)

_EVENTS_A_LOOK = 64
"""Most events of connections that are read at once; the rest wait for the next time."""


class Input(Protocol):
    """A transport that messages are taken from."""

    ended: bool

    def receive(self) -> bytes | None:
        """The next message, or None if there is none at present; never blocks."""
        ...

    def close(self) -> None:
        """Give back what the input holds."""
        ...


class SocketInput:
    """A subscribing socket that is bound, so that any number of publishers may connect.

    Args:
        address: `ipc://path`, or TCP on the loopback interface; `tcp://127.0.0.1:*` takes any port.
            With an authenticator, TCP on any interface.
        authenticator: Accepts the clients that it knows, when its handshakes are answered; None: no
            keys.
        connections: Greatest number at once. The next call of `limit_connections` ends further
            connections; their messages may be read until then.

    Attributes:
        authenticator: As above.
        sender: Client that the last message came from; None where there are no keys.
        connections: How many there were when they were last counted.
        descriptors: The first becomes readable when messages come, the second when connections
            begin or end, once what they tell of was found to be empty.
        is_unread: Whether messages may wait. False once it was found empty, by a message that left
            nothing behind or in vain; True again once its descriptor is readable.
        has_events: Alike, of connections that have begun or ended.

    Raises:
        StreamError: The address cannot be used.
    """

    def __init__(
        self,
        address: str,
        authenticator: Authenticator | None = None,
        *,
        connections: int = CONNECTION_LIMIT,
    ) -> None:
        check_address(address, has_keys=authenticator is not None)
        check_free(address)
        self.ended = False
        self.sender: str | None = None
        self._in_parts = False
        self.authenticator = authenticator
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context.instance()
        if authenticator is not None:
            context = authenticator.context
        self._socket: zmq.Socket[bytes] = context.socket(zmq.SUB)
        self._socket.set(zmq.LINGER, 0)
        self._socket.set(zmq.RCVHWM, _WAITING_MESSAGES)
        self._socket.set(zmq.MAXMSGSIZE, FRAME_LIMIT)
        self._socket.subscribe(b"")
        self._polled = [(self._socket, _POLLIN)]
        if authenticator is not None:
            authenticator.guard(self._socket, INPUT_RIGHTS)
        self.is_unread = self.has_events = True
        self._limit, self.connections = connections, 0
        changes = f"inproc://connections-{next(_numbers)}"
        self._socket.monitor(changes, zmq.EVENT_ACCEPTED | zmq.EVENT_DISCONNECTED)
        self._events: zmq.Socket[bytes] = context.socket(zmq.PAIR)
        # With a limit, events that nobody reads would hold up the thread that takes messages.
        self._events.set(zmq.RCVHWM, 0)
        self._events.set(zmq.LINGER, 0)
        self._events.connect(changes)
        try:
            self._socket.bind(address)
        except zmq.ZMQError as error:
            self._close_sockets()
            raise explain(address, error) from None
        self.address = self._socket.get_string(zmq.LAST_ENDPOINT)
        self.descriptors = int(self._socket.get(zmq.FD)), int(self._events.get(zmq.FD))

    def limit_connections(self) -> int:
        """End connections beyond as many as there may be, the newest first; never blocks.

        ZeroMQ has no such limit. It tells the descriptor of each connection that it accepts, and
        takes one that is shut down for one that its sender has ended.

        Returns:
            How many were ended.
        """
        ended, events = 0, self._events
        for _ in range(_EVENTS_A_LOOK):
            if not int(events.get(zmq.EVENTS)) & zmq.POLLIN:
                self.has_events = False
                break
            head, *_ = events.recv_multipart(zmq.NOBLOCK)
            kind, descriptor = struct.unpack("=Hi", head)
            if kind == zmq.EVENT_DISCONNECTED:
                self.connections -= 1
                continue
            self.connections += 1
            if self.connections > self._limit:
                ended += self._end(descriptor)
        return ended

    def _end(self, descriptor: int) -> bool:
        """Shut down a connection, unless its descriptor is something else by now."""
        copy = -1
        try:
            copy = os.dup(descriptor)
            with socket.socket(fileno=copy) as connection:
                copy = -1
                name = connection.getsockname()
                if connection.family == socket.AF_UNIX:
                    is_own = self.address == f"ipc://{name}"
                else:
                    is_own = self.address.rpartition(":")[2] == str(name[1])
                if is_own:
                    connection.shutdown(socket.SHUT_RDWR)
        except OSError:
            # It has ended by itself.
            return False
        finally:
            if copy >= 0:
                os.close(copy)
        return is_own

    def receive(self) -> bytes | None:
        """The next message, or None where nothing waited.

        Raises:
            MessageError: For one too long or in several parts.
        """
        try:
            if self.authenticator is None:
                data: bytes = self._socket.recv(_NOBLOCK)
            else:
                # A frame knows who sent it, and takes half a microsecond more.
                frame = self._socket.recv(_NOBLOCK, copy=False)
                data, self.sender = frame.bytes, str(frame.get("User-Id"))
        except zmq.Again:
            self.is_unread = False
            self.sender = None
            return None
        # To ask costs a third of what it costs to try in vain.
        self.is_unread = bool(zmq.zmq_poll(self._polled, 0))
        # All parts of a message come at once.
        has_more = self.is_unread and bool(self._socket.get(zmq.RCVMORE))
        in_parts, self._in_parts = self._in_parts or has_more, has_more
        if in_parts:
            raise self._refuse("in several parts", "one part")
        if len(data) > BYTE_LIMIT:
            raise self._refuse(f"{len(data)} bytes long", f"at most {BYTE_LIMIT}")
        return data

    def _refuse(self, found: str, expected: str) -> MessageError:
        return MessageError("message", found, expected, self.sender or "unknown")

    def close(self) -> None:
        """Unbind and close; what waits in the queue is dropped."""
        if not self._socket.closed:
            remove_file(self.address)
        self._close_sockets()

    def _close_sockets(self) -> None:
        if not self._socket.closed:
            self._socket.monitor(None, 0)
        self._events.close()
        self._socket.close()


class LineInput:
    """JSON lines from a pipe or file, read as they come, with no thread.

    Args:
        descriptor: File descriptor to read from; 0 is standard input.
    """

    def __init__(self, descriptor: int = 0) -> None:
        self.ended = False
        self._descriptor = descriptor
        self._buffer = bytearray()
        self._scanned = 0
        self._skipping = False
        self._at_end = False
        try:
            os.fstat(descriptor)
        except OSError as error:
            raise StreamError("-", f"cannot be read ({error.strerror})") from None

    def receive(self) -> bytes | None:
        """The next line, or None; raises MessageError for one that is too long.

        So it does where a sender that never pauses sends nothing but blank lines, or a line without
        an end: a call takes a bounded time.
        """
        left = BYTE_LIMIT
        while True:
            if left < 0:
                problem = f"without a message for {BYTE_LIMIT} bytes, or {_BLANK_LINES} blank lines"
                raise MessageError("line", problem, "messages")
            end = self._buffer.find(b"\n", self._scanned)
            if end >= 0:
                line = self._take(end)
                if self._skipping:
                    self._skipping = False
                elif line.strip():
                    return line
                left -= max(end + 1, BYTE_LIMIT // _BLANK_LINES)
                continue
            self._scanned = len(self._buffer)
            if self._skipping:
                left -= len(self._buffer)
                self._take(len(self._buffer))
            elif len(self._buffer) > BYTE_LIMIT:
                self._take(len(self._buffer))
                self._skipping = True
                raise MessageError("line", f"over {BYTE_LIMIT} bytes long", "a shorter one")
            if self._at_end:
                line = self._take(len(self._buffer))
                self.ended = True
                return line if line.strip() else None
            if not self._read():
                return None

    def _take(self, end: int) -> bytes:
        line = bytes(self._buffer[:end])
        del self._buffer[: end + 1]
        self._scanned = 0
        return line

    def _read(self) -> bool:
        """Read what is there; False if that is nothing yet."""
        if not select.select([self._descriptor], [], [], 0.0)[0]:
            return False
        try:
            chunk = os.read(self._descriptor, 65536)
        except (BlockingIOError, InterruptedError):
            return False
        except OSError:  # a terminal that hung up has ended as surely as a closed pipe
            chunk = b""
        self._buffer += chunk
        self._at_end = not chunk
        return True

    def close(self) -> None:
        """Nothing to give back: the descriptor belongs to the caller."""


class InputWatch:
    """Looks after inputs before messages are taken from them.

    Args:
        faults: The log that counts refused clients.
    """

    def __init__(self, faults: FaultLog) -> None:
        self._faults = faults
        self._inputs: list[Input] = []
        self._sockets: list[SocketInput] = []
        self._authenticators: set[Authenticator] = set()
        self._by_messages: dict[int, SocketInput] = {}
        self._by_events: dict[int, SocketInput] = {}
        self._poll = select.poll()

    def attend(self, inputs: Sequence[Input]) -> Sequence[Input]:
        """Note which sockets have something to read, and admit clients; never blocks.

        Each call accepts a few clients, and counts refused ones.

        Returns:
            Inputs that were not among those of the last call.
        """
        new = self._register(inputs) if self._inputs != inputs else ()
        for descriptor, _ in self._poll.poll(0):
            source = self._by_messages.get(descriptor)
            if source is None:
                self._by_events[descriptor].has_events = True
            else:
                source.is_unread = True
        for source in self._sockets:
            if source.has_events and (ended := source.limit_connections()):
                problem = "has its greatest number of connections; a further one was ended"
                self._faults.add("connections", source.address, None, problem, ended)
        # The inputs of a run have one authenticator, which answers once for all of them.
        for authenticator in self._authenticators:
            authenticator.answer()
            for error, times in authenticator.take_refused():
                self._faults.add(error.kind, error.source, None, str(error), times)
        return new

    def _register(self, inputs: Sequence[Input]) -> Sequence[Input]:
        """Look at these inputs from now on, and at no others; those that are new."""
        new = [source for source in inputs if source not in self._inputs]
        self._inputs = list(inputs)
        self._sockets = [source for source in inputs if isinstance(source, SocketInput)]
        guards = (source.authenticator for source in self._sockets)
        self._authenticators = {one for one in guards if one is not None}
        self._by_messages = {source.descriptors[0]: source for source in self._sockets}
        self._by_events = {source.descriptors[1]: source for source in self._sockets}
        self._poll = select.poll()
        for descriptor in (*self._by_messages, *self._by_events):
            self._poll.register(descriptor, select.POLLIN)
        return new
