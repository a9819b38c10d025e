"""Streams between processes: obstacles and joint states to the monitor, verdicts from it.

ZeroMQ over ipc or loopback TCP, in msgpack or JSON, or JSON lines on standard input. `Publisher`
and `VerdictReader` are for users' nodes; `Edge` and the inputs are the monitor's side.
"""

from armguard.streams.addresses import JOINTS_ADDRESS, OBSTACLES_ADDRESS, VERDICTS_ADDRESS
from armguard.streams.authentication import Authenticator, Client
from armguard.streams.edge import Edge, EdgeSettings
from armguard.streams.faults import FaultLog
from armguard.streams.inputs import Input, LineInput, SocketInput
from armguard.streams.joint_intake import JointState
from armguard.streams.keys import KeyPair, Keys
from armguard.streams.nodes import Publisher, VerdictPublisher, VerdictReader
from armguard.streams.source_accounts import SourceLimits
from armguard.streams.stamp_clocks import StampClock

__all__ = [
    "JOINTS_ADDRESS",
    "OBSTACLES_ADDRESS",
    "VERDICTS_ADDRESS",
    "Authenticator",
    "Client",
    "Edge",
    "EdgeSettings",
    "FaultLog",
    "Input",
    "JointState",
    "KeyPair",
    "Keys",
    "LineInput",
    "Publisher",
    "SocketInput",
    "SourceLimits",
    "StampClock",
    "VerdictPublisher",
    "VerdictReader",
]
