"""Messages of each kind that a recording holds, with numbers that are hard to write."""

import math

import numpy as np

from armguard.contact import Certificate
from armguard.messages.answers import to_plan_message, to_verdict_message
from armguard.messages.events import (
    DroppedPoints,
    FaultsTaken,
    MalformedCall,
    Payload,
    PromiseBroken,
    StaticObstacle,
    TetherEnded,
    TetherStated,
)
from armguard.messages.incoming import (
    IgnoreMessage,
    ObstaclesMessage,
    PlanMessage,
    RemoveMessage,
    ResetMessage,
    WatchMessage,
)
from armguard.messages.proof import (
    BrakeColumns,
    CoverBall,
    JointPlace,
    ObstacleState,
    Proof,
    ProvedMotion,
    Separation,
    TrustedArm,
    TrustedCover,
    seal,
)
from armguard.recording.events import (
    BodiesChanged,
    Gap,
    JointState,
    Link,
    Log,
    MalformedPlan,
    MalformedState,
    Time,
)
from armguard.verdict import Held, Level, PlanVerdict, Reason, ReasonKind, Verdict

ODD = [-0.0, 5e-324, 1.7976931348623157e308, math.inf, -math.inf, math.nan]
PACKED = np.array(ODD).tobytes()
CAUSE = Reason(ReasonKind.CONTACT, "a and b", "in 1 s")
VERDICT = Verdict(
    stamp=0.1 + 0.2,
    sequence=3,
    level=Level.SLOW,
    contact_time=math.inf,
    stop_time=-0.0,
    speed_scale=math.nan,
    link="panda_hand",
    obstacle="naïve “id”\n",
    complete=False,
    evaluated=12,
    reasons=(Reason(ReasonKind.HOLD), CAUSE),
    valid_until=1e-300,
)
PROOF = Certificate(0.25, np.array([0.1, math.inf]), np.array([[1.0, 0.0, -0.0], [0.0, 0.6, 0.8]]))
VERDICTS = [
    VERDICT,
    VERDICT._replace(link=None, obstacle=None, level=Level.STOP, stop="brake"),
    VERDICT._replace(separation=-0.125, stop="finish", certificate=PROOF),
    VERDICT._replace(reasons=(), stamp=-0.0),
    VERDICT._replace(stop="finish", proved_until=0.1 + 0.2),
    VERDICT._replace(held=Held(None, math.inf, 0.25, 1.5, 2.0)),
    VERDICT._replace(held=Held(CAUSE, 0.1, 0.25, -0.0, 2.0)),
    VERDICT._replace(contact_time=-0.0, harm_time=5e-324, contact_speed=0.1 + 0.2),
    VERDICT._replace(harm_time=math.nan, contact_speed=math.inf),
]
MOTION = ProvedMotion(
    told="never", times=[0.0, 0.1], high=ODD, low=[], fastest=[], slowest=[],
    separations=[Separation(node=-1, state=0, ends=[1], directions=[1.0, -0.0, 5e-324])],
)  # fmt: skip
VERDICT_PROOF = Proof(
    stamp=0.1 + 0.2, now=0.5, sequence=3, level="SLOW", link="hand", obstacle="naïve “id”",
    q=[0.1], v=[-0.0], period=1e-3, latency=0.0, reaction_time=5e-324, margin=0.0, max_speed=0.0,
    arm=TrustedArm(
        digest="",
        joints=[JointPlace(name="a", parent=-1, slides=False, axis=ODD[:3], placement=ODD * 2)],
        lower=[-math.inf], upper=[math.inf], acceleration=[2.0], operating_velocity=[1.0],
        operating_acceleration=[1.0], position_error=[0.0], velocity_error=[0.0],
        brakes=[BrakeColumns(speed=[math.inf], deceleration=[0.0], time=[0.1], distance=[1.0])],
    ),
    cover=TrustedCover(
        digest="", link="hand", carrier=0, reach=[0.0, 0.1, 0.2, 1.5], parents=[-1, 0],
        balls=[CoverBall(node=0, center=ODD[:3], radius=0.1, lever=[0.3])],
    ),
    states=[
        ObstacleState(
            stamp=0.4, points=ODD, velocities=ODD, radius=0.1, position_error=0.0,
            velocity_error=math.inf, accel=math.inf, speed=1.6,
        )
    ],
    motions=[MOTION],
)  # fmt: skip
seal(VERDICT_PROOF.arm)
MESSAGES = [
    VERDICT_PROOF,
    JointState(-0.0, ["a", "b"], PACKED[:16], PACKED[16:32], now=math.nan),
    MalformedState(math.nan, "q", "not an array of numbers", 0.0),
    ObstaclesMessage([], 1.5, "camera", position=b"", radius=0.0),
    ObstaclesMessage(["a"], 1.5, "camera", position=PACKED, radius=0.1),
    ObstaclesMessage(
        *(["a", "b"], 5e-324, "camera", None, "tilted", True, PACKED, PACKED, PACKED[:16]),
        *(math.inf, None, PACKED[24:40], math.nan),
    ),
    StaticObstacle(id="post", position=PACKED[:24], radius=0.1),
    StaticObstacle(id="door", position=PACKED, radius=0.1, speed=2.0, accel=math.inf),
    RemoveMessage(["a"], math.nan, ""),
    MalformedCall(source="", offender="ids", problem="is odd", stamp=math.nan),
    PromiseBroken(source="right", joint="a", problem="is too fast", stamp=0.5),
    DroppedPoints(source="depth", stamp=0.5, points=3, dropped=1),
    FaultsTaken(),
    Payload(payload=1.5),
    TetherStated(a="elbow", b="hand", length=0.4, source="a tape measure"),
    TetherEnded(a="elbow", b="hand"),
    IgnoreMessage(1, "", "*", "post", None, 0.5),
    IgnoreMessage(2, "", "*", "post", "camera", None, PACKED * 2),
    WatchMessage(2),
    ResetMessage(""),
    PlanMessage(
        "commit", 1, 0.5, ["a", "b"], PACKED[:8], PACKED[:16], PACKED[:16], 0.1, PACKED[:16]
    ),
    MalformedPlan("plan", "is a str"),
    to_plan_message(1, PlanVerdict(False, math.inf, None, None, (CAUSE,))),
    *map(to_verdict_message, VERDICTS),
    BodiesChanged(revision=2, links=[Link("hand"), Link("tool", "{}")]),
    Gap(events=7, seconds=0.01),
    Log(timestamp=Time(1, 2), level=3, message="a line"),
]
