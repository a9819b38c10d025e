"""Which inputs have something to read, by one system call for all of them; and who may connect.

A vain attempt to receive costs as much as receiving does, and most inputs have nothing in most
ticks. ZeroMQ's descriptors are edge-triggered: they tell of what has come since a socket was last
found empty. So a socket that was not found empty counts as readable, whatever its descriptor says.
"""

from __future__ import annotations

import select
from collections.abc import Sequence

from armguard.streams.authentication import Authenticator
from armguard.streams.faults import FaultLog
from armguard.streams.inputs import Input, SocketInput


class InputWatch:
    """Looks after inputs before messages are taken from them.

    Args:
        faults: Where it is counted who was not let in.
    """

    def __init__(self, faults: FaultLog) -> None:
        self._faults = faults
        self._inputs: list[Input] = []
        self._sockets: list[SocketInput] = []
        self._authenticators: set[Authenticator] = set()
        self._by_descriptor: dict[int, SocketInput] = {}
        self._poll = select.poll()

    def attend(self, inputs: Sequence[Input]) -> None:
        """Note which sockets have something to read, and admit clients; never blocks.

        A few clients a call are let in, and it is counted who may not be.
        """
        if self._inputs != inputs:
            self._register(inputs)
        for descriptor, _ in self._poll.poll(0):
            self._by_descriptor[descriptor].notice(descriptor)
        for source in self._sockets:
            if source.has_events and (ended := source.limit_connections()):
                problem = "has as many connections as may be; one too many was ended"
                self._faults.add("connections", source.address, None, problem, ended)
        # The inputs of a run have one authenticator, which answers once for all of them.
        for authenticator in self._authenticators:
            authenticator.answer()
            for error, times in authenticator.take_refused():
                self._faults.add(error.kind, error.source, None, str(error), times)

    def _register(self, inputs: Sequence[Input]) -> None:
        """Look at these inputs from now on, and at no others."""
        self._inputs = list(inputs)
        self._sockets = [source for source in inputs if isinstance(source, SocketInput)]
        guards = (source.authenticator for source in self._sockets)
        self._authenticators = {one for one in guards if one is not None}
        self._by_descriptor = {
            descriptor: source for source in self._sockets for descriptor in source.descriptors
        }
        self._poll = select.poll()
        for descriptor in self._by_descriptor:
            self._poll.register(descriptor, select.POLLIN)
