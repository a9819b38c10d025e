"""The view: shows a monitor's state in the browser, from its own process.

A monitor publishes frames with a `FramePublisher`, which never waits for a view. The view
process, which `launch` starts, keeps the newest frame, turns it into drawing commands and serves
Meshcat's viewer on the loopback interface. A slow or dead view or browser never delays a tick of
the monitor.
"""

from typing import TYPE_CHECKING

from armguard.lazy import lazy_names

if TYPE_CHECKING:
    from armguard.view.buckets import compute_buckets
    from armguard.view.messages import (
        FrameMessage,
        LinkCover,
        ObstacleShapes,
        Pairs,
        SceneMessage,
        VerdictSummary,
    )
    from armguard.view.process import ViewProcess, launch
    from armguard.view.publisher import FramePublisher
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "FrameMessage": "armguard.view.messages",
            "FramePublisher": "armguard.view.publisher",
            "LinkCover": "armguard.view.messages",
            "ObstacleShapes": "armguard.view.messages",
            "Pairs": "armguard.view.messages",
            "SceneMessage": "armguard.view.messages",
            "VerdictSummary": "armguard.view.messages",
            "ViewProcess": "armguard.view.process",
            "compute_buckets": "armguard.view.buckets",
            "launch": "armguard.view.process",
        },
    )

__all__ = [
    "FrameMessage",
    "FramePublisher",
    "LinkCover",
    "ObstacleShapes",
    "Pairs",
    "SceneMessage",
    "VerdictSummary",
    "ViewProcess",
    "compute_buckets",
    "launch",
]
