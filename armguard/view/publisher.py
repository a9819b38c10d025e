"""Publishes frames for the views that are attached, and never waits for one.

ZeroMQ's PUB socket drops what a subscriber does not take; two messages at most are kept for each,
so a view that hangs costs neither time nor memory, and finds the present when it wakes.
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
"""Frames after which the scene is told again, for views that attached late."""


class FramePublisher:
    """A socket that views attach to.

    Args:
        address: Where to bind, e.g. "ipc:///tmp/view" or "tcp://127.0.0.1:*".
        authenticator: Lets in the views that it knows; None: there are no keys.
        is_patient: Whether it waits for the first view, and for slow ones up to `PATIENCE` a
            message: for replays, which nothing waits for.

    Attributes:
        address: Where views attach, with the port that was chosen.
        dropped: Messages that could not be sent.
        problem: Why the last of these could not; empty if all were sent.

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
        """Tell what does not change; it is repeated by itself among the frames."""
        self._scene = scene
        self._frames_since_scene = 0
        self._send(scene)

    def publish_frame(self, frame: FrameMessage) -> None:
        """Tell one moment; a view that does not keep up misses it."""
        self._frames_since_scene += 1
        if self._frames_since_scene >= SCENE_INTERVAL and self._scene is not None:
            self._frames_since_scene = 0
            self._send(self._scene)
        self._send(frame)

    def publish_status(self, status: StatusMessage) -> None:
        """Tell what the monitor does that has no moments to show."""
        self._send(status)

    def close(self) -> None:
        """Free the address; whatever is published afterwards is dropped."""
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
