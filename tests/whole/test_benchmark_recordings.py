"""The benchmark beside recorded people runs, and its rivals are what they claim to be."""

import math

import numpy as np
import pytest

from armguard.contact import earliest_contact_pair
from armguard.lab.simulation import JointTrajectory, random_trajectory
from armguard.obstacles import Obstacles
from armguard.pairs import compute_separation
from armguard.robot import OperatingLimits, Robot

PERIOD = 0.01


@pytest.fixture
def trajectory():
    robot = Robot.load("panda")
    return random_trajectory(robot, 0, 20.0, speed_fraction=0.3, acceleration_fraction=0.4)


@pytest.fixture
def people(load):
    """Two people in the middle of whom the arm stands."""
    return [make_people(load, path) for path in find_recordings(load("bench_recordings"))[:2]]


def make_people(load, path, x=0.2, y=-0.6):
    placement = load("bench_recordings").place_base(x, y, -90.0)
    return load("scene.recorded_people").People(path, placement, {"some": (10.0, 2.0)})


def find_recordings(benchmark):
    try:
        return benchmark.find_recordings()
    except SystemExit as missing:
        pytest.skip(str(missing))


def make_setting(load, reaction=0.02):
    return load("scene.stop_rules").Setting(reaction, 0.0, "some")


def test_a_short_run(load, tmp_path):
    benchmark, contestants = load("bench_recordings"), load("scene.contestants")
    find_recordings(benchmark)
    page = tmp_path / "page.md"
    short = "--speeds 0.8 --reactions 0.02 --cameras 0 --seconds 0.5 --placements 1 --recordings 1"
    arguments = [*short.split(), "--bounds", "10 m/s², 2 m/s", "--out", str(page)]
    found = benchmark.main(arguments)
    tables = sorted((tmp_path / "page").iterdir())
    text = "".join(one.read_text(encoding="utf-8") for one in (page, *tables))
    for one in found:
        assert one.rule in text
        assert 0 <= one.outcome.stopped <= one.outcome.ticks <= 50
        assert one.outcome.missed == 0
    rules = {one.rule for one in found}
    assert {contestants.ORACLE, contestants.SEPARATION, contestants.BRAKING} <= rules
    assert {one.how for one in found} == {"goes on", "obeys", "obeys the scale"}


def test_a_rule_that_lets_everything_pass_is_found_out(load, trajectory, people):
    rules, plays = load("scene.stop_rules"), load("scene.plays")
    arm = load("scene.working_arm").WorkingArm

    class Blind(rules.Rule):
        def judge(self, moment):
            return True

    robot, setting = trajectory.robot, make_setting(load)
    stage = plays.Stage(robot, PERIOD)
    blind = Blind(robot, setting, PERIOD, "blind")
    oracle = rules.Oracle(robot, setting, PERIOD, "knows the future")
    hits = missed = 0
    for person in people:
        judged, best = stage.judge(person, arm(trajectory), [blind, oracle], 2.0)
        assert 0 < judged.ticks == best.ticks <= 200
        assert judged.stopped == 0
        assert judged.missed + judged.beyond == judged.needed == best.needed
        assert best.missed + best.beyond == 0
        hits += judged.hits
        obeyed = stage.obey(person, arm(trajectory), blind, 2.0, by_scale=False)
        assert obeyed.stopped == 0
        assert obeyed.missed + obeyed.beyond == judged.hits
        # Obeyed, the one that knows the future prevents them all.
        obeyed = stage.obey(person, arm(trajectory), oracle, 2.0, by_scale=False)
        assert obeyed.missed + obeyed.beyond == 0
        missed += judged.missed
    assert hits > 0
    assert missed > 0


def test_contact_limits_are_those_of_the_bodies(load):
    touches, example = load("scene.touches"), load("scene.example_limits")
    names = load("scene.recorded_people").NAMES
    speeds = touches.find_speed_limits(example.LIMITS, example.PATTERNS_OF_REGIONS)
    found = dict(zip(names, speeds, strict=True))
    assert found["head"] == 0.0
    # As the literature quotes them.
    assert found["left_hand"] == found["right_hand"] == pytest.approx(1.32, abs=0.01)
    assert found["left_elbow"] == pytest.approx(1.13, abs=0.01)
    assert found["left_shoulder"] == pytest.approx(1.0, abs=0.01)
    assert found["collar"] == found["hip"] == pytest.approx(0.28, abs=0.01)


def test_a_touch_is_as_deep_and_fast_as_it_is(load, trajectory):
    leaves = load("scene.clearance").Leaves(trajectory.robot)
    find_touch = load("scene.touches").find_touch
    random, dt = np.random.default_rng(5), 1e-6
    for _ in range(20):
        q, v = trajectory.sample(random.uniform(0.0, trajectory.duration))
        place = leaves.kinematics.data.oMi
        leaves.place(q, v)
        center = leaves.centers[random.integers(len(leaves.radius))]
        ends = np.tile(center + random.normal(size=3) * 0.05, (2, 1))
        depth, speed, pressing = find_touch(
            leaves.centers, leaves.velocities, leaves.spins, leaves.radius, ends, 0.05
        )
        ways = ends[0] - leaves.centers
        distances = np.linalg.norm(ways, axis=1)
        depths = leaves.radius + 0.05 - distances
        assert depth == pytest.approx(depths.max())
        # Points of the surface, carried by their links.
        touching = np.flatnonzero(depths >= 0.0)
        points = (leaves.centers + leaves.radius[:, None] * ways / distances[:, None])[touching]
        joints = leaves.kinematics.spheres.joint[leaves._leaves[touching]]
        before = [place[j].actInv(x) for j, x in zip(joints.tolist(), points, strict=True)]
        leaves.place(q + dt * v, v)
        moved = np.array([place[j].act(x) for j, x in zip(joints.tolist(), before, strict=True)])
        rates = (moved - points) / dt
        assert speed == pytest.approx(np.linalg.norm(rates, axis=1).max(), abs=1e-4)
        along = (rates * ways[touching] / distances[touching, None]).sum(axis=1)
        assert pressing == pytest.approx(max(0.0, along.max()), abs=1e-4)


def test_touches_are_followed_from_an_arm_that_moves(load, trajectory):
    touches, people = load("scene.touches"), load("scene.recorded_people")
    leaves = load("scene.clearance").Leaves(trajectory.robot)
    q, v = trajectory.sample(3.0)
    leaves.place(q, v)
    far, broken = np.full((9, 2, 3), 50.0), np.zeros(9, bool)
    near = far.copy()
    head = people.NAMES.index("head")
    near[head] = leaves.centers[-1]
    log = touches.TouchLog(np.zeros(9))
    leaves.place(q, 0.0 * v)
    log.follow(0.0, 0.1, leaves, near, broken)
    assert not log.touches
    leaves.place(q, v)
    for since, ends in ((0.1, near), (0.2, near), (0.3, far), (0.4, near)):
        log.follow(since, 0.1, leaves, ends, broken)
    first, second = log.touches
    assert (first.body, first.begin, second.begin) == ("head", 0.1, 0.4)
    assert first.duration == pytest.approx(0.1)
    assert second.duration == 0.0
    assert first.speed == first.fastest > 0.0
    assert first.depth > people.RADII[head]
    assert first.is_beyond


def test_an_arm_with_contact_limits_keeps_them(load, trajectory, people):
    """And one that obeys nobody is found out."""
    rules, plays = load("scene.stop_rules"), load("scene.plays")
    example, arm = load("scene.example_limits"), load("scene.working_arm").WorkingArm
    robot, given = trajectory.robot, (trajectory.robot, make_setting(load), PERIOD)
    operating = OperatingLimits.fraction(robot, velocity=0.32, acceleration=0.27)
    limited = {"operating": operating, "contact_limits": example.LIMITS}

    class Blind(rules.Rule):
        def judge(self, moment):
            return True

    blind = Blind(*given, "blind")
    monitor = rules.MonitorRule(*given, "limited", **limited)
    pieces = rules.PieceRule(*given, "pieces", motion="planned", **limited)
    blind.limits = np.zeros(9)  # nothing may be touched
    stage = plays.Stage(robot, PERIOD)
    beyond = dict.fromkeys((blind.name, monitor.name, pieces.name), 0)
    for person in people:
        for rule in (blind, monitor, pieces):
            obeyed = stage.obey(person, arm(trajectory), rule, 2.0, by_scale=False)
            assert obeyed.stopped_blocked <= obeyed.blocked <= obeyed.ticks
            beyond[rule.name] += sum(one.is_beyond for one in obeyed.touches if one.is_promised)
            if rule is monitor:
                assert obeyed.stopped_blocked == obeyed.blocked
            if rule is pieces:
                # It may take up a piece that recedes from what it touches.
                assert obeyed.stopped_blocked > 0 or not obeyed.blocked
    assert beyond.pop(blind.name) > 0
    assert not any(beyond.values())


def test_the_separation_is_the_one_of_the_formula(load, trajectory):
    rules = load("scene.stop_rules")
    bodies = load("scene.recorded_people")
    robot = trajectory.robot
    person = make_people(load, find_recordings(load("bench_recordings"))[0], 0.0, 0.9)
    rule = rules.Separation(robot, make_setting(load, 0.05), PERIOD, "separation")
    rule.begin(person, 0.0)
    arm = load("scene.working_arm").WorkingArm(trajectory)
    leaves = load("scene.clearance").Leaves(robot)
    random = np.random.default_rng(0)
    answers = []
    for frame in random.integers(100, len(person.ends) - 1, 30):
        arm.q, arm.v = trajectory.sample(random.uniform(0.0, trajectory.duration))
        leaves.place(arm.q, arm.v)
        since = frame / person.rate
        apart = rule.judge(rules.Moment(since, since, arm, leaves, np.zeros(9), person, True))
        sent = person.streams["some", True].sent[frame]
        margin = math.inf
        for body, last in enumerate(sent):
            if last < 0:
                continue
            a, b = person.seen[last, body]
            share = (leaves.centers - a) @ (b - a) / max((b - a) @ (b - a), 1e-12)
            way = a + np.clip(share, 0.0, 1.0)[:, None] * (b - a) - leaves.centers
            distance = np.linalg.norm(way, axis=1)
            towards = np.maximum(0.0, (way * leaves.velocities).sum(axis=1) / distance)
            for link in range(len(robot.links)):
                spheres = leaves.link == link
                joints = (np.abs(arm.v) / robot.braking_deceleration)[leaves.moves[link]]
                apart_by = compute_separation(
                    towards[spheres],
                    0.057,
                    joints.max(),
                    human_uncertainty=0.002 + 1.6 * (since - last / person.rate),
                )
                room = distance[spheres] - leaves.radius[spheres] - bodies.RADII[body]
                margin = min(margin, (room - apart_by).min())
        assert apart == (margin > 0.0)
        answers.append(apart)
    assert 0 < sum(answers) < len(answers)


def test_what_could_touch_is_no_later_than_a_contact_time_says(load):
    """The one tries what a ball can do, and the other bounds it."""
    random, find_room = np.random.default_rng(3), load("scene.least_rule").find_room
    moving, radius, gaps = np.ones(1, bool), np.array([0.1]), []
    for _ in range(400):
        place = random.normal(size=3)
        place *= random.uniform(0.3, 1.5) / np.linalg.norm(place)
        velocity = random.normal(size=3)
        velocity *= random.uniform(0.0, 2.0) / np.linalg.norm(velocity)
        bound = earliest_contact_pair(
            np.zeros(3), np.zeros(3), 0.0, 0.0, place, velocity, 10.0, 2.0, 0.25
        )
        ends, velocities = np.tile(place, (1, 2, 1)), np.tile(velocity, (1, 2, 1))
        times = np.linspace(0.0, 2.0, 401)
        touched = next(
            time for time in times
            if find_room(
                np.zeros((1, 3)), radius, moving, ends, velocities, np.array([0.15]),
                np.array([time]), np.array([[10.0, 2.0]]), 0.0, np.zeros(1),
            )[0] <= 0.0
        )  # fmt: skip
        assert touched >= bound - 1e-9
        gaps.append(touched - bound)
    # And hardly later: it is what a ball that attacks needs.
    assert np.median(gaps) < 0.01


def test_a_monitor_stops_wherever_a_sound_rule_must(load, trajectory, people):
    rules, robot, setting = load("scene.stop_rules"), trajectory.robot, make_setting(load)
    operating = OperatingLimits.fraction(robot, velocity=0.32, acceleration=0.27)
    given, least_rule = (robot, setting, PERIOD), load("scene.least_rule").LeastRule
    pairs = [
        (least_rule(*given, "least"), rules.MonitorRule(*given, "monitor")),
        (
            least_rule(*given, "least, errors included", fastest=operating.resolve(robot)[0]),
            rules.MonitorRule(*given, "operating limits", operating=operating),
        ),
    ]
    stage = load("scene.plays").Stage(robot, PERIOD)
    needed = np.zeros(len(pairs), dtype=int)
    for person in people:
        arm = load("scene.working_arm").WorkingArm(trajectory)
        for moment in stage._moments(person, arm, [rule for pair in pairs for rule in pair], 2.0):
            for k, (least, monitor) in enumerate(pairs):
                may_go, goes = least.judge(moment), monitor.judge(moment)
                assert may_go or not goes
                needed[k] += not may_go
            arm.step(PERIOD, moment.counts)
    # Errors and an arm that leaves its path when it likes are reasons to stop.
    assert 20 < needed[0] < needed[1]


def test_each_stop_on_data_as_they_come_has_one_cause(load, trajectory):
    """Bodies are hidden and markers are swapped in this recording, near the arm."""
    rules, plays = load("scene.stop_rules"), load("scene.plays")
    arm = load("scene.working_arm").WorkingArm
    path = next(x for x in find_recordings(load("bench_recordings")) if x.stem.startswith("pick"))
    person, given = (
        make_people(load, path, 0.0, 0.7),
        (trajectory.robot, make_setting(load), PERIOD),
    )
    contestants = [
        rules.MonitorRule(*given, "monitor", clean=False),
        rules.MonitorRule(*given, "tied", clean=False, tied="anybody"),
        rules.Separation(*given, "separation", clean=False),
        rules.ForgetfulSeparation(*given, "no hidden", clean=False),
    ]
    judged = plays.Stage(trajectory.robot, PERIOD).judge(person, arm(trajectory), contestants, 5.0)
    monitor, tied, separation, forgetful = judged
    for one in (monitor, tied):
        assert one.stopped == sum(one.causes.values()) + one.stopped_blocked
        assert set(one.causes) <= {*rules.FAULTS, rules.HELD}
    # A shoulder is hidden that is near its elbow.
    assert tied.stopped < monitor.stopped
    assert set(monitor.causes) & set(rules.FAULTS[:3])
    assert not separation.causes
    assert forgetful.stopped < separation.stopped


def test_limbs_are_tied_by_lengths_that_people_keep_to(load):
    """Both lengths hold between clean samples, and joints are within the limbs that meet there."""
    tied, bodies = load("scene.tied_people"), load("scene.recorded_people")
    shapes = {body.name: body for body in (*bodies.BODIES, *tied.JOINTS)}
    for path in find_recordings(load("bench_recordings")):
        person = make_people(load, path)
        points = bodies.Recording(path).position
        points[~bodies.measure_motion(points, person.rate).is_clean] = np.nan
        places = dict(zip(bodies.POINTS, points.transpose(1, 0, 2), strict=True))
        tethers = zip(tied.list_tethers(person.bones), tied.list_tethers(tied.BONES), strict=True)
        for (a, b, length), (_, _, longest) in tethers:
            assert length <= longest
            for one, other in ((shapes[a], shapes[b]), (shapes[b], shapes[a])):
                for point in one.points:
                    first, last = places[other.points[0]], places[other.points[-1]]
                    way = last - first
                    along = ((places[point] - first) * way).sum(axis=1)
                    with np.errstate(invalid="ignore"):
                        share = np.nan_to_num(along / (way**2).sum(axis=1)).clip(0.0, 1.0)
                    nearest = first + share[:, None] * way
                    assert np.nanmax(np.linalg.norm(places[point] - nearest, axis=1)) <= length
    for joint in tied.JOINTS:
        limbs = [body for body in bodies.BODIES if joint.points[0] in body.points]
        assert all(joint.radius <= body.radius for body in limbs)


def test_clean_samples_leave_no_fault(load, people):
    for person in people:
        stream, table = person.streams["some", True], Obstacles()
        for frame in range(len(person.ends)):
            stream.publish(table, frame, 100.0)
        assert not table.take_faults()
        assert not table.table.refused.any()


def test_it_says_what_is_missing(load, monkeypatch, tmp_path):
    monkeypatch.setenv("ARMGUARD_RECORDINGS", str(tmp_path))
    with pytest.raises(SystemExit, match="ARMGUARD_RECORDINGS"):
        load("bench_recordings").main([])


def test_the_arm_keeps_its_promises(load, trajectory):
    robot, random = trajectory.robot, np.random.default_rng(0)
    working = load("scene.working_arm")
    arm = working.WorkingArm(trajectory)
    dt, go, stopped_for, limit = 1e-3, True, 0.0, np.inf
    longest = np.max(robot.velocity_limit / robot.braking_deceleration)
    share = working.ACCELERATION_SHARE * robot.acceleration_limit
    most = np.maximum(share, robot.braking_deceleration) * (1.0 + 1e-6)
    rested = False
    for _ in range(8000):
        if random.random() < 0.005:
            go = not go
        if random.random() < 0.01:
            limit = random.uniform(0.02, 0.4) * robot.velocity_limit
        before_q, before_v = arm.q, arm.v
        arm.step(dt, go, limit)
        rate = (arm.v - before_v) / dt
        assert (np.abs(rate) <= most).all()
        assert (np.abs(arm.v) <= 0.3 * robot.velocity_limit * (1.0 + 1e-9)).all()
        np.testing.assert_allclose(arm.q - before_q, 0.5 * dt * (arm.v + before_v), atol=1e-6)
        stopped_for = 0.0 if go else stopped_for + dt
        rested = rested or (arm.braking and arm.rests)
        if stopped_for > longest:
            assert arm.rests
    assert rested
    assert 0.0 < arm.progress < 8.0


def test_the_arm_does_what_it_plans(load, trajectory):
    arm = load("scene.working_arm").WorkingArm(trajectory)
    times = np.linspace(0.0, 0.2, 21)
    for go in (True, True, True, False, False, False, True, True):
        if go:
            expected, _ = arm.preview(times)
            for k in range(40):
                if k % 2 == 0:
                    np.testing.assert_allclose(arm.q, expected[k // 2], atol=1e-4)
                arm.step(0.005, True)
        else:
            arm.step(0.3, False)


def test_verdicts_take_effect_when_they_must(load):
    plays = load("scene.plays")
    steps = []

    class Arm:
        def step(self, dt, go, *limits):
            steps.append((dt, go))

    brakes = plays.Brakes(Arm(), 0.022)
    brakes.tell(0.0, False)
    for tick in range(10):
        brakes.tell(0.005 * tick, tick >= 3)
        brakes.run(0.005 * tick, 0.005)
    ends = np.cumsum([dt for dt, _ in steps])
    assert ends[-1] == pytest.approx(0.05)
    goes = [end for end, (_, go) in zip(ends, steps, strict=True) if go]
    assert max(goes) == pytest.approx(0.015 + 0.022)
    assert min(goes) > 0.002


def test_the_benchmark_of_the_persons_own_speed_runs(load, capsys):
    find_recordings(load("bench_recordings"))
    arguments = "--person-speeds own 2 --speeds 0.8 --seconds 0.3 --placements 1 --recordings 2"
    scores = load("bench_person_speed").main(arguments.split())
    assert {score.person_speed for score in scores} == {"–", "own", "2.0"}
    for score in scores:
        assert 0 <= score.outcome.stopped <= score.outcome.ticks <= 30
    # √(2² + 1.32²) − 2 for a hand, √(2² + 0.28²) − 2 for a chest.
    assert {score.allowed for score in scores} == {"–", "1.32, 0.28", "0.40, 0.02"}
    assert "| separation distance |" in capsys.readouterr().out


def test_a_trajectory_through_the_arm_itself_is_drawn_anew(load, monkeypatch):
    bench = load("bench_recordings")
    find_recordings(bench)
    robot, path = Robot.load("panda"), bench.find_recordings()[0]
    seen = []

    def reject_two(trajectory, seconds):
        seen.append(trajectory)
        return len(seen) < 3

    monkeypatch.setattr(bench, "meets_itself", reject_two)
    assert bench.make_trajectory(robot, 0.3, path, 0, 1.0) is seen[2]
    starts = [trajectory.sample(0.0)[0] for trajectory in seen]
    assert not np.allclose(starts[0], starts[1])
    assert not np.allclose(starts[1], starts[2])


def test_an_arm_that_goes_through_itself_is_found_out(load):
    robot = Robot.load("panda")
    meets_itself = load("scene.self_contact").meets_itself
    upright = np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0])
    folded = np.array([0.0, 0.0, 0.0, -3.0, 0.0, 0.8, 0.0])

    def go(*waypoints):
        return JointTrajectory(
            robot, np.stack(waypoints), speed_fraction=0.5, acceleration_fraction=0.4
        )

    assert not meets_itself(go(upright, upright + 0.2), 1.0)
    assert meets_itself(go(upright, folded), 10.0)
