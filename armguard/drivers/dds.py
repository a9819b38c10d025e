"""Topics of a ROS 2 graph, without ROS: `cyclonedds` implements the wire protocol.

ROS 2 sends its messages by DDS, in the encoding that DDS calls XCDR1. A topic `/name` is `rt/name`
there, and a type `package/msg/Name` is `package::msg::dds_::Name_`. Nothing here waits.
"""

from __future__ import annotations

import dataclasses
import functools
import types
from collections.abc import Iterator
from typing import Any

from cyclonedds.core import DDSException
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl import types as idl
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from armguard.bridges.ros2_types import FIELDS, Field
from armguard.drivers.arm import ArmLostError

_ENCODING = Policy.DataRepresentation(use_cdrv0_representation=True)
"""XCDR1."""

_PLAIN = {"string": str, "bool": bool}
"""Primitive types whose names differ from those of the library."""


@functools.cache
def find_type(name: str) -> Any:
    """The class of messages of a type, such as `"std_msgs/msg/Float64"`, with its fields."""
    fields = {field.name: _find_field(field) for field in FIELDS[name]}
    package, _, plain = name.split("/")
    made = types.new_class(
        plain,
        (IdlStruct,),
        {"typename": f"{package}.msg.dds_.{plain}_"},
        lambda namespace: namespace["__annotations__"].update(fields),
    )
    return dataclasses.dataclass(made)


def _find_field(field: Field) -> Any:
    if "/" in field.kind:
        kind = find_type(field.kind)
    else:
        kind = _PLAIN.get(field.kind) or getattr(idl, field.kind)
    if field.length is None:
        return kind
    return idl.array[kind, field.length] if field.length else idl.sequence[kind]


class Inlet:
    """Messages of one topic, in the order of arrival.

    Args:
        reader: Reads them.
        depth: Greatest number of waiting messages; older ones are lost.

    Attributes:
        unreadable: Number of unreadable messages.
    """

    def __init__(self, reader: DataReader[Any], depth: int) -> None:
        self.unreadable = 0
        self._reader = reader
        self._depth = depth

    def take(self) -> Iterator[Any]:
        """Messages since the last call, the oldest first.

        Raises:
            ArmLostError: DDS has failed.
        """
        for _ in range(self._depth):
            try:
                samples = self._reader.take(1)
            except DDSException as error:
                raise ArmLostError(f"DDS: {error}") from None
            except Exception:
                # Whatever a stranger sends: the library reads it without a check of its own.
                self.unreadable += 1
                continue
            if not samples:
                return
            if samples[0].sample_info.valid_data:
                yield samples[0]


class Outlet:
    """Sends messages of one topic; a message that is not accepted at once is lost.

    Args:
        writer: Sends them.
    """

    def __init__(self, writer: DataWriter[Any]) -> None:
        self._writer = writer

    def send(self, message: Any) -> None:
        """Send a message.

        Raises:
            ArmLostError: DDS has failed.
        """
        try:
            self._writer.write(message)
        except DDSException as error:
            if error.code == DDSException.DDS_RETCODE_TIMEOUT:
                return  # a subscriber holds it up, for which nothing here waits
            raise ArmLostError(f"DDS: {error}") from None


class Graph:
    """A participant in the graph of one domain.

    Args:
        domain: Its number.

    Raises:
        ArmLostError: It cannot be joined.
    """

    def __init__(self, domain: int) -> None:
        try:
            self._participant = DomainParticipant(domain)
        except DDSException as error:
            raise ArmLostError(f"domain {domain} cannot be joined: {error}") from None

    def subscribe(self, topic: str, kind: str, depth: int, *, is_kept: bool = False) -> Inlet:
        """Listen to a topic.

        Args:
            topic: As ROS calls it, such as `/joint_states`.
            kind: Type of its messages.
            depth: How many may wait.
            is_kept: Whether earlier messages are received too, as those of `/tf_static`; otherwise
                publishers of either reliability are received.
        """
        policies: list[Any] = [_ENCODING, Policy.History.KeepLast(depth)]
        if is_kept:
            policies += [Policy.Reliability.Reliable(0), Policy.Durability.TransientLocal]
        else:
            policies += [Policy.Reliability.BestEffort]
        reader = DataReader(self._participant, self._make_topic(topic, kind), Qos(*policies))
        return Inlet(reader, depth)

    def publish(self, topic: str, kind: str) -> Outlet:
        """Send a topic, so that subscribers of either reliability receive its newest message."""
        qos = Qos(_ENCODING, Policy.Reliability.Reliable(0), Policy.History.KeepLast(1))
        return Outlet(DataWriter(self._participant, self._make_topic(topic, kind), qos))

    def _make_topic(self, topic: str, kind: str) -> Topic[Any]:
        return Topic(self._participant, f"rt/{topic.strip('/')}", find_type(kind))
