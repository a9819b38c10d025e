"""Publishes frames for views, and never waits for a view.

ZeroMQ's PUB socket keeps at most two messages for each subscriber and drops the others. So a view
that hangs costs no time and little memory, and gets recent frames when it continues.
"""

from __future__ import annotations

import zmq

from armguard.streams.addresses import check_address, check_free, explain, remove_file
from armguard.streams.authentication import Authenticator
from armguard.view.messages import (
    FrameMessage,
    Message,
    SceneMessage,
    StatusMessage,
    encode_message,
)

PATIENCE = 5.0
"""How long a patient publisher waits for its views, in [s]."""

SCENE_INTERVAL = 15
"""Number of frames after which the scene is sent again, for views that attached late."""


class FramePublisher:
    """A socket to which views attach.

    Args:
        address: Address to bind, e.g. "ipc:///tmp/view" or "tcp://127.0.0.1:*".
        authenticator: Authenticates views; None: no keys.
        is_patient: Whether it waits for the first view, and for slow views up to `PATIENCE` per
            message. For replays, which are not in real time.

    Attributes:
        address: Address to which views attach, with the port that was chosen.
        dropped: Number of messages that could not be sent.
        problem: Why the last of them could not be sent; empty if all were sent.

    Raises:
        StreamError: The address is malformed, reaches beyond this machine without keys, or is in
            use.
    """

    def __init__(
        self,
        address: str,
        authenticator: Authenticator | None = None,
        *,
        is_patient: bool = False,
    ) -> None:
        check_address(address, has_keys=authenticator is not None)
        check_free(address)
        self.dropped = 0
        self.problem = ""
        self._scene: SceneMessage | None = None
        self._frames_since_scene = 0
        self._authenticator = authenticator
        self._is_patient = is_patient
        self._is_heard = not is_patient
        # A context of its own, or that of its authenticator: closing waits for no other sockets.
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        context = self._context if authenticator is None else authenticator.context
        # XPUB publishes as PUB does, and tells when a view begins to listen.
        self._socket = context.socket(zmq.XPUB if is_patient else zmq.PUB)
        self._socket.set(zmq.SNDHWM, 64 if is_patient else 2)
        if is_patient:
            self._socket.set(zmq.XPUB_NODROP, 1)
            self._socket.set(zmq.SNDTIMEO, round(1000 * PATIENCE))
        self._socket.set(zmq.LINGER, 0)
        if authenticator is not None:
            authenticator.guard(self._socket, ["view"])
        try:
            self._socket.bind(address)
        except zmq.ZMQError as error:
            self._free()
            raise explain(address, error) from None
        self.address = self._socket.get_string(zmq.LAST_ENDPOINT)

    def publish_scene(self, scene: SceneMessage) -> None:
        """Send the scene, which does not change; it is repeated automatically between frames."""
        self._scene = scene
        self._frames_since_scene = 0
        self._send(scene)

    def publish_frame(self, frame: FrameMessage) -> None:
        """Send one moment; a view that is too slow misses it."""
        self._frames_since_scene += 1
        if self._frames_since_scene >= SCENE_INTERVAL and self._scene is not None:
            self._frames_since_scene = 0
            self._send(self._scene)
        self._send(frame)

    def publish_status(self, status: StatusMessage) -> None:
        """Send the status of a monitor that has no moments to show."""
        self._send(status)

    def close(self) -> None:
        """Free the address; messages published afterwards are dropped."""
        if not self._socket.closed:
            remove_file(self.address)
        self._free()

    def __enter__(self) -> FramePublisher:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _free(self) -> None:
        self._socket.close()
        self._context.destroy(linger=0)

    def _send(self, message: Message) -> None:
        if self._authenticator is not None:
            # Whatever is told: views attach while kernels are compiled, before any frame.
            self._authenticator.answer()
        if not self._is_heard:
            self._is_heard = True
            self._socket.poll(round(1000 * PATIENCE))
        try:
            flags = 0 if self._is_patient else zmq.NOBLOCK
            self._socket.send(encode_message(message), flags)
        except (zmq.ZMQError, TypeError, ValueError, OverflowError) as error:
            # An observer must not hurt the loop: whatever it is, count it and go on.
            self.dropped += 1
            self.problem = str(error)
