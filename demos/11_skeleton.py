"""A camera that tracks a person's joints, beside an arm: from a kit's JSON to verdicts.

The frames have the format of a ZED camera. They show a simulated person whose right wrist is hidden
from time to time. The rest is the code of a node for a real camera.
"""

import json

import armguard
from armguard.bridges.skeletons import MODELS, SkeletonReader
from armguard.lab.simulation.bodies import POINTS
from armguard.lab.simulation.person import ProceduralPerson
from armguard.people import UPPER_BODY, Skeleton

RATE, ERROR = 30.0, 0.03  # of the camera: [Hz], and what joints are off by, in [m]
VISIT = 12.0  # of the person, [s]
HOME = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]  # [rad]


def make_frame(person: ProceduralPerson, time: float) -> str:
    """What a camera writes of the person at a time."""
    position, _ = person.sample(time)
    seen = {name.replace("hand", "wrist"): position[k] for k, name in enumerate(POINTS)}
    for side, off in (("left", 0.07), ("right", -0.07)):
        seen[f"{side}_ear"] = seen["head"] + [0.0, off, 0.0]
        seen[f"{side}_hip"] = seen["hip"] + [0.0, 1.3 * off, 0.0]
    if time % 2.0 < 0.4:
        del seen["right_wrist"]
    joints = MODELS["zed"][0].joints
    nowhere = [float("nan")] * 3
    return json.dumps(
        {
            "timestamp": round(1e9 * time),
            "body_list": [
                {
                    "id": 1,
                    "tracking_state": "OBJECT_TRACKING_STATE.OK",
                    "keypoint": [list(seen.get(joint, nowhere)) for joint in joints],
                    "keypoint_confidence": [90.0 * (joint in seen) for joint in joints],
                }
            ],
        }
    )


def main(duration: float = VISIT) -> int:
    """Watch a resting arm while the person comes; how many frames were read."""
    person = ProceduralPerson(seed=1, duration=VISIT)
    obstacles = armguard.Obstacles(sources=["camera"])
    monitor = armguard.Monitor(armguard.Robot.load("panda"), obstacles, rate=3.0 * RATE)
    reader, skeletons, frames, level = SkeletonReader(), {}, 0, None
    for tick in range(round(3.0 * RATE * duration)):
        now = tick / (3.0 * RATE)  # [s], on the clock that stamps joint states as well
        frame = reader.take(make_frame(person, now), now) if tick % 3 == 0 else None
        if frame is not None:
            frames += 1
            if not frame.bodies:
                obstacles.update([], now, radius=0.0, source="camera")  # nobody, but still here
            for body in frame.bodies:
                if body.person not in skeletons:
                    # A table hides the legs from the camera, and keeps them from the arm.
                    skeletons[body.person] = Skeleton(
                        body.person, height=1.8, parts=UPPER_BODY, source="camera"
                    )
                skeletons[body.person].update(obstacles, now, body.find_seen(), ERROR)
        verdict = monitor.step(now, HOME, [0.0] * 7)
        if verdict.level is not level:
            level = verdict.level
            print(f"{now:5.2f} s: {level.name}, {verdict.reasons[0] if verdict.reasons else ''}")
    print(f"{frames} frames, {reader.bad_frames.total()} bad ones, {len(obstacles)} obstacles")
    return frames


if __name__ == "__main__":
    main()
