"""A simulated Franka Research 3 for tests: franka-sim, in an environment of its own.

Run by a Python that has franka-sim, with the address to serve at. Each line of its input is run as
Python, with `server` at hand, and answered by a line: what `answer` is then.

Three things are other than in franka-sim. It would fetch a model of the arm from the network; here
it gets the masses and joints of the description that it brings along. It counts milliseconds by the
states that it has sent, which are fewer on a busy machine; on the wire they are milliseconds here,
as those of a real robot. And a reflex lasts until a client recovers from it, not until another one
connects.
"""

import collections
import os
import re
import socket
import struct
import sys
import tempfile
import threading
import time
import traceback
from pathlib import Path

import franka_sim
import mujoco
from franka_sim.server import state_stream

COMMANDS = collections.deque([(0.0, (0.0,) * 7)], maxlen=100_000)
"""Positions that came, with the time of each; at first none did."""


class ClockedSocket(socket.socket):
    """Numbers of states are milliseconds outside, and consecutive inside."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self._numbers = collections.deque([(0, 0)], maxlen=1000)

    def sendto(self, data, address):
        number = max(self._numbers[-1][0] + 1, int(1000.0 * time.monotonic()))
        self._numbers.append((number, struct.unpack_from("<Q", data)[0]))
        return super().sendto(struct.pack("<Q", number) + data[8:], address)

    def recvfrom(self, size):
        data, address = super().recvfrom(size)
        COMMANDS.append((time.monotonic(), struct.unpack_from("<7d", data, 8)))
        number = dict(self._numbers).get(struct.unpack_from("<Q", data)[0], 0)
        return struct.pack("<Q", number) + data[8:], address


class Sockets:
    """Stands for the module `socket`."""

    socket = ClockedSocket

    def __getattr__(self, name):
        return getattr(socket, name)


def make_model(folder):
    """The description without its meshes, and with motors that have inertia, as a file."""
    text = (Path(franka_sim.__file__).parent / "models" / "fr3.urdf").read_text()
    text = re.sub(r"<(visual|collision)\b.*?</\1>", "", text, flags=re.DOTALL)
    model = mujoco.MjSpec.from_string(text)
    for joint in model.joints:
        joint.armature = 0.6  # less, and the servos of the simulation are not stable
    model.compile()
    path = Path(folder) / "fr3.xml"
    path.write_text(model.to_xml())
    return path


class Server(franka_sim.FrankaSimServer):
    def reset_state(self):
        kept = getattr(self, "robot_state", None)
        super().reset_state()
        if kept is not None and kept.state["robot_mode"] == 4:
            names = ("robot_mode", "errors", "reflex_reason")
            self.robot_state.state.update({name: kept.state[name] for name in names})


def serve(host):
    state_stream.socket = Sockets()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["FR3_MJCF"] = str(make_model(folder))
        server = Server(
            host=host,
            enable_gripper=False,
            enforce_comm_constraints=True,
            enforce_motion_limits=True,
        )
        threading.Thread(target=obey, args=[{"server": server}], daemon=True).start()
        server.start()


def see(server):
    """Where the arm is, how fast its fastest joint is, and in which mode the robot is."""
    arm = server.physics_sim.get_robot_state()
    mode = server.robot_state.state["robot_mode"]
    return [float(q) for q in arm["q"]], max(abs(float(v)) for v in arm["dq"]), int(mode)


def obey(names):
    names.update(see=see, COMMANDS=COMMANDS, time=time)
    for line in sys.stdin:
        try:
            exec(line, names)
            answer = repr(names.get("answer"))
        except Exception:
            answer = traceback.format_exc().replace("\n", " ")
        sys.stdout.write(answer + "\n")
        sys.stdout.flush()
    os._exit(0)


if __name__ == "__main__":
    serve(sys.argv[1])
