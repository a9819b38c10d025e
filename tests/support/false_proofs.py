"""Proofs that were tampered with, and whether what they claim has become false.

That is decided by a counterexample in 40 digits: a motion of a joint that leaves the tube or does
not end with it, places of the arm and of the obstacle that leave no gap along the direction, or a
place and a velocity at which a point of the arm is too fast. Not a line is shared with what checks
proofs, or with what makes them.
"""

import copy
import hashlib
import json

import mpmath
from mpmath import mpf

mpmath.mp.dps = 40
NEVER = mpf(10) ** 30
DELAYS = {"this": ["latency", "reaction_time"], "next": ["period", "latency", "reaction_time"]}


def number(value):
    return NEVER if value == "Infinity" else -NEVER if value == "-Infinity" else mpf(value)


def seal(part):
    """Give what is trusted the digest that it has now."""
    stated = {key: value for key, value in part.items() if key != "digest"}
    text = json.dumps(stated, sort_keys=True, separators=(",", ":"))
    part["digest"] = hashlib.sha256(text.encode()).hexdigest()


class Extreme:
    """A motion of one joint within its limits, as far one way (1: up, -1: down) as it can go."""

    def __init__(self, proof, joint, sign, free):
        arm = proof["arm"]
        one = {key: number(arm[key][joint]) for key in arm if key not in ("digest", "joints",
                                                                          "brakes")}  # fmt: skip
        q, v = mpf(proof["q"][joint]), sign * mpf(proof["v"][joint])
        ends = sign * one["upper"] - sign * q, sign * one["lower"] - sign * q
        # It is truly as far back as its error lets it be, and as fast.
        is_inside = -min(ends) >= one["position_error"]
        self.room = max(*ends, 0) + (one["position_error"] if is_inside else 0)
        self.accel, self.speeding = one["acceleration"], one["operating_acceleration"]
        self.top = max(one["operating_velocity"], abs(v))
        self.start = min(v + one["velocity_error"], self.top)
        self.free = free
        self.brakes = [
            {key: number(arm["brakes"][joint][key][k]) for key in arm["brakes"][joint]}
            for k in range(len(arm["brakes"][joint]["speed"]))
        ]

    def at(self, s):
        """Its displacement and velocity s after its stamp; None where no such motion is known."""
        way, speed = self.move(min(s, self.free))
        if way >= self.room:
            return self.room, mpf(0)
        if s > self.free:
            braked = self.brake(speed, s - self.free)
            if braked is None:
                return None
            way, speed = way + braked[0], braked[1]
            if way >= self.room:
                return self.room, mpf(0)
        return way, speed

    def move(self, s):
        way, speed = mpf(0), self.start
        if speed < 0:
            turn = min(s, -speed / self.accel)
            way, speed, s = (
                way + speed * turn + self.accel * turn**2 / 2,
                speed + self.accel * turn,
                s - turn,
            )
        ramp = min(s, (self.top - speed) / self.speeding)
        way += speed * ramp + self.speeding * ramp**2 / 2
        speed += self.speeding * ramp
        return way + speed * (s - ramp), speed

    def brake(self, speed, s):
        if speed <= 0:
            until = min(s, -speed / self.accel)
            return speed * until + self.accel * until**2 / 2, speed + self.accel * until
        fitting = [entry for entry in self.brakes if speed <= entry["speed"]]
        if not fitting:
            return None
        entry = fitting[0]
        rate, held = entry["deceleration"], mpf(0)
        gentle = rate > 0 and speed / rate <= entry["time"]
        if not (gentle and speed**2 / (2 * rate) <= entry["distance"]):
            # It goes on as it is, and then brakes as hard as it can.
            rate = self.accel
            hard = speed / rate
            held = min(entry["time"] - hard, (entry["distance"] - speed * hard / 2) / speed)
            if held < 0 or entry["deceleration"] > 0:
                return None
        steady, slowing = min(s, held), min(max(s - held, 0), speed / rate)
        way = speed * steady + speed * slowing - rate * slowing**2 / 2
        return way, speed - rate * slowing


def find_free(proof, motion):
    age = mpf(proof["now"]) - mpf(proof["stamp"])
    if motion["told"] == "never":
        return age, NEVER
    return age, age + sum(mpf(proof[name]) for name in DELAYS[motion["told"]])


def leaves_tube(proof, motion, node, joint, sign):
    """Whether a joint can be outside the tube at a node."""
    age, free = find_free(proof, motion)
    found = Extreme(proof, joint, sign, free).at(age + mpf(motion["times"][node]))
    bound = motion["high" if sign > 0 else "low"][node * len(proof["q"]) + joint]
    return found is not None and found[0] > sign * mpf(bound)


def leaves_somewhere(proof, motion):
    return any(
        leaves_tube(proof, motion, node, joint, sign)
        for node in range(0, len(motion["times"]), 4)
        for joint in range(len(proof["q"]))
        for sign in (1, -1)
    )


def moves_on(proof, motion):
    """Whether a joint can still move when the tube of an arm that brakes ends."""
    age, free = find_free(proof, motion)
    end = age + mpf(motion["times"][-1])
    for joint in range(len(proof["q"])):
        for sign in (1, -1):
            found = Extreme(proof, joint, sign, free).at(end)
            if found is not None and found[1] > 0:
                return True
    return False


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))


def rotate(rows, a):
    return [dot(row, a) for row in rows]


def place(proof, q):
    """Rotation and origin of each joint's frame, and its axis, in the world."""
    frames = []
    for joint, angle in zip(proof["arm"]["joints"], q, strict=True):
        numbers, axis = [mpf(x) for x in joint["placement"]], [mpf(x) for x in joint["axis"]]
        rows, origin = [numbers[0:3], numbers[3:6], numbers[6:9]], numbers[9:12]
        if joint["parent"] >= 0:
            base, place, _ = frames[joint["parent"]]
            origin = [x + y for x, y in zip(rotate(base, origin), place, strict=True)]
            rows = [[dot(row, [rows[k][c] for k in range(3)]) for c in range(3)] for row in base]
        along = rotate(rows, axis)
        if joint["slides"]:
            origin = [x + angle * y for x, y in zip(origin, along, strict=True)]
        else:
            columns = []
            for c in range(3):
                unit = [mpf(int(k == c)) for k in range(3)]
                around, share = cross(axis, unit), dot(axis, unit) * (1 - mpmath.cos(angle))
                columns.append([
                    unit[k] * mpmath.cos(angle) + around[k] * mpmath.sin(angle) + axis[k] * share
                    for k in range(3)
                ])  # fmt: skip
            turn = [[columns[c][k] for c in range(3)] for k in range(3)]
            rows = [[dot(row, [turn[k][c] for k in range(3)]) for c in range(3)] for row in rows]
        frames.append((rows, origin, along))
    return frames


def find_center(proof, node, q):
    """A ball's centre, and the derivatives by joints."""
    cover = proof["cover"]
    columns = [[mpf(0)] * 3 for _ in q]
    if node == -1:
        return [mpf(x) for x in cover["reach"][:3]], columns
    ball = next(one for one in cover["balls"] if one["node"] == node)
    center, joint = [mpf(x) for x in ball["center"]], cover["carrier"]
    frames = place(proof, q)
    if joint >= 0:
        rows, origin, _ = frames[joint]
        center = [x + y for x, y in zip(rotate(rows, center), origin, strict=True)]
    while joint >= 0:
        stated, (_, origin, axis) = proof["arm"]["joints"][joint], frames[joint]
        arm = [x - y for x, y in zip(center, origin, strict=True)]
        columns[joint] = axis if stated["slides"] else cross(axis, arm)
        joint = stated["parent"]
    return center, columns


def find_radius(proof, node):
    cover = proof["cover"]
    if node == -1:
        return mpf(cover["reach"][3])
    return mpf(next(one for one in cover["balls"] if one["node"] == node)["radius"])


def lacks_gap(proof, motion, separation, step):
    """Whether arm and obstacle can be where a direction leaves no gap at the end of its time."""
    end = separation["ends"][step]
    normal = [mpf(x) for x in separation["directions"][3 * step : 3 * step + 3]]
    size = mpmath.sqrt(dot(normal, normal))
    if size == 0:
        return True
    normal = [x / size for x in normal]
    q, count = [mpf(x) for x in proof["q"]], len(proof["q"])
    _, columns = find_center(proof, separation["node"], q)
    there = [
        angle + mpf(motion["high" if dot(normal, column) > 0 else "low"][end * count + joint])
        for joint, (angle, column) in enumerate(zip(q, columns, strict=True))
    ]
    center, _ = find_center(proof, separation["node"], there)
    state = proof["states"][separation["state"]]
    reach = sum(mpf(x) for x in (state["radius"], state["position_error"], proof["margin"]))
    reach += find_radius(proof, separation["node"])
    s = mpf(proof["now"]) - mpf(state["stamp"]) + mpf(motion["times"][end])
    for k in range(0, len(state["points"]), 3):
        point = [mpf(x) for x in state["points"][k : k + 3]]
        velocity = [mpf(x) for x in state["velocities"][k : k + 3]]
        closing = -dot(normal, velocity)
        aside = max(dot(velocity, velocity) - closing**2, 0)
        top = max(number(state["speed"]), mpmath.sqrt(dot(velocity, velocity)))
        top = mpmath.sqrt(max(top**2 - aside, 0))
        start = min(closing + number(state["velocity_error"]), top)
        accel = number(state["accel"])
        ramp = min(s, (top - start) / accel) if accel > 0 else s
        come = start * ramp + accel * ramp**2 / 2 + (start + accel * ramp) * (s - ramp)
        if dot(normal, [x - y for x, y in zip(point, center, strict=True)]) - come <= reach:
            return True
    return False


def find_speed(proof, motion, separation, random):
    """How fast a ball's centre can be when it is said to be slow enough."""
    count = len(proof["q"])
    node = separation["ends"][-1] if separation["ends"] else 0
    places = range(node * count, (node + 1) * count)
    q = [
        mpf(angle) + min(max(mpf(0), mpf(motion["low"][k])), mpf(motion["high"][k]))
        for angle, k in zip(proof["q"], places, strict=True)
    ]
    _, columns = find_center(proof, separation["node"], q)
    greatest = mpf(0)
    for _ in range(8):
        along = [mpf(x) for x in random.normal(size=3)]
        paces = [
            mpf(motion["fastest" if dot(along, column) > 0 else "slowest"][k])
            for column, k in zip(columns, places, strict=True)
        ]
        moved = [sum(w * c[axis] for w, c in zip(paces, columns, strict=True)) for axis in range(3)]
        greatest = max(greatest, mpmath.sqrt(dot(moved, moved)))
    return greatest


def list_steps(proof):
    return [
        (motion, separation, step)
        for motion in proof["motions"]
        for separation in motion["separations"]
        for step in range(len(separation["ends"]))
    ]


def list_slow(proof):
    return [
        (motion, one)
        for motion in proof["motions"]
        for one in motion["separations"]
        if (one["ends"][-1] if one["ends"] else 0) < len(motion["times"]) - 1
    ]


def tamper(proof, kind, random):
    """A changed copy; whether its claim is surely false; None where this kind does not apply."""
    proof = copy.deepcopy(proof)
    steps, share = list_steps(proof), float(10.0 ** random.uniform(-7.0, 0.0))
    if kind == "tube":
        motion = proof["motions"][random.integers(len(proof["motions"]))]
        node = int(random.integers(1, len(motion["times"])))
        joint, sign = int(random.integers(len(proof["q"]))), int(random.choice([1, -1]))
        age, free = find_free(proof, motion)
        found = Extreme(proof, joint, sign, free).at(age + mpf(motion["times"][node]))
        if found is None:
            return None
        bound = float(sign * (found[0] - share * (abs(found[0]) + mpf("1e-6"))))
        motion["high" if sign > 0 else "low"][node * len(proof["q"]) + joint] = bound
        return proof, leaves_tube(proof, motion, node, joint, sign)
    if kind == "later":
        motion = proof["motions"][random.integers(len(proof["motions"]))]
        motion["times"] = [t * (1.0 + share) for t in motion["times"]]
        return proof, leaves_somewhere(proof, motion)
    if kind in ("latency", "rest"):
        motions = [one for one in proof["motions"] if one["told"] != "never"]
        if not motions:
            return None
        motion = motions[0]
        if kind == "latency":
            proof["latency"] *= 1.0 + 10.0 * share
            return proof, leaves_somewhere(proof, motion) or moves_on(proof, motion)
        last = int(random.integers(1, len(motion["times"]) - 1))
        count = len(proof["q"])
        motion["times"] = motion["times"][: last + 1]
        for key in ("high", "low", "fastest", "slowest"):
            motion[key] = motion[key][: (last + 1) * count]
        motion["separations"] = []
        return proof, moves_on(proof, motion)
    if kind == "speed":
        slow = list_slow(proof)
        if not slow:
            return None
        motion, one = slow[random.integers(len(slow))]
        speed = find_speed(proof, motion, one, random)
        proof["max_speed"] = float(speed * (1 - mpf(share) / 2))
        return proof, speed > mpf(proof["max_speed"])
    if kind == "reach":
        brakes = [one for one in proof["motions"] if one["told"] != "never" and one["fastest"]]
        balls = proof["cover"]["balls"]
        if not brakes or not balls:
            return None
        speed = max(
            find_speed(proof, brakes[0], {"node": ball["node"], "ends": []}, random)
            for ball in balls
        )
        brakes[0]["separations"] = [
            {"node": -1, "state": state, "ends": [], "directions": []}
            for state in range(len(proof["states"]))
        ]
        proof["max_speed"] = float(speed * (1 - mpf(share) / 2))
        return proof, speed > mpf(proof["max_speed"])
    if kind == "swapped":
        motion, count = proof["motions"][random.integers(len(proof["motions"]))], len(proof["q"])
        a, b = random.choice(count, 2, replace=False)
        for key in ("high", "low"):
            rows = [motion[key][k : k + count] for k in range(0, len(motion[key]), count)]
            for row in rows:
                row[a], row[b] = row[b], row[a]
            motion[key] = [x for row in rows for x in row]
        return proof, leaves_somewhere(proof, motion)
    if not steps:
        return None
    motion, separation, step = steps[random.integers(len(steps))]
    place = slice(3 * step, 3 * step + 3)
    normal = separation["directions"][place]
    state = proof["states"][separation["state"]]
    if kind == "direction":
        aside = random.normal(size=3) * 10.0 ** random.uniform(-1.0, 1.0)
        separation["directions"][place] = [float(x + y) for x, y in zip(normal, aside, strict=True)]
    elif kind == "nearer":
        way = 10.0 ** random.uniform(-3.0, 0.5)
        moved = [x - way * normal[k % 3] for k, x in enumerate(state["points"])]
        state["points"] = [float(x) for x in moved]
    elif kind == "older":
        state["stamp"] -= 10.0 ** random.uniform(-2.0, 1.0)
    elif kind == "faster":
        state["velocities"] = [
            float(x - 4.0 * share * normal[k % 3]) for k, x in enumerate(state["velocities"])
        ]
    elif kind == "margin":
        proof["margin"] += 10.0 ** random.uniform(-3.0, 0.5)
    elif kind == "ball":
        balls = proof["cover"]["balls"]
        if separation["node"] == -1:
            proof["cover"]["reach"][3] += 10.0 ** random.uniform(-3.0, 0.5)
        else:
            next(b for b in balls if b["node"] == separation["node"])["radius"] += 10.0 ** (
                random.uniform(-3.0, 0.5)
            )
        seal(proof["cover"])
    return proof, lacks_gap(proof, motion, separation, step)


KINDS = (
    "tube", "later", "latency", "rest", "speed", "direction", "nearer", "older", "faster", "margin",
    "ball", "reach", "swapped",
)  # fmt: skip
