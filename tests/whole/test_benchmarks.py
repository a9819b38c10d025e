"""The benchmarks of the schedules run, and their contestants answer what they are asked."""

import math

import numpy as np
import pytest

from armguard.bounds import IsotropicMotion, ReachMotion
from armguard.contact import earliest_contact_pair
from armguard.pairs.hull_distance import HullDistance
from armguard.robot import Kinematics, Robot
from armguard.robot.kinematics import ArmSpheres
from armguard.verdict import Level

ACCEL, SPEED, RADIUS = 10.0, 2.0, 0.1


@pytest.fixture(scope="module")
def panda():
    return Robot.load("panda")


@pytest.fixture
def work(load, panda):
    return load("scene.crowds").Work(panda, 200, 0.3)


@pytest.fixture(params=range(4))
def balls(request):
    """Where balls were when they were measured, how fast, and when. All above and near the arm."""
    random = np.random.default_rng(request.param)
    nearest, count = (0.6, 1.5, 3.0, 6.0)[request.param], 300
    direction = random.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    position = direction * random.uniform(nearest, nearest + 4.0, (count, 1)) + (0.0, 0.0, 0.4)
    velocity = random.uniform(-1.0, 1.0, (count, 3))
    return position, velocity, np.repeat([0.05, 0.09], count // 2)


def watch(contestant, balls, work, tick=100):
    """What a contestant says at a tick, a tenth of a second after the clock's beginning."""
    position, velocity, stamps = balls
    for stamp in np.unique(stamps):
        found = np.flatnonzero(stamps == stamp)
        rows = slice(int(found[0]), int(found[-1]) + 1)
        names = [f"ball-{k}" for k in found]
        contestant.update(rows, names, float(stamp), position[rows], velocity[rows])
    for _ in range(2):  # the second time it knows who decided
        contestant.step(0.1, work.q[tick], work.v[tick], float(work.stop_time[tick]))
    return contestant.read()


def compute_sphere_times(panda, balls, work, tick=100):
    """Isotropic contact times of all spheres of the cover. Shape (spheres, balls)."""
    position, velocity, stamps = balls
    kinematics, motion = Kinematics(panda), IsotropicMotion(panda)
    kinematics.compute(work.q[tick], work.v[tick])
    motion.update(work.v[tick])
    times = [
        earliest_contact_pair(
            kinematics.centers[i], kinematics.velocities[i], motion.accel[i], motion.speed[i],
            position, velocity, ACCEL, SPEED,
            kinematics.spheres.radius[i] + motion.position_error[i] + RADIUS,
            age2=0.1 - stamps, velocity_error1=motion.velocity_error[i],
        )
        for i in range(len(kinematics.spheres))
    ]  # fmt: skip
    return np.array(times)


def compute_pair_times(panda, balls, work):
    """Isotropic contact times, and those to links' workspace balls. Shapes (links, balls)."""
    position, velocity, stamps = balls
    workspace = [
        earliest_contact_pair(
            ball[:3], np.zeros(3), 0.0, 0.0, position, velocity, ACCEL, SPEED, ball[3] + RADIUS,
            age2=0.1 - stamps,
        )
        for ball in ReachMotion(panda).link_balls
    ]  # fmt: skip
    free = compute_sphere_times(panda, balls, work)[ArmSpheres(panda).root]
    return free, np.array(workspace)


@pytest.mark.parametrize("rung", ["bounds", "spheres"])
def test_a_sweep_over_bounds_finds_the_earliest_pair(load, panda, work, balls, rung):
    rivals, spheres = load("scene.rivals"), ArmSpheres(panda)
    free = compute_sphere_times(panda, balls, work)
    free = free[spheres.root if rung == "bounds" else spheres.child_count == 0]
    answer = watch(rivals.Sweep(work, len(balls[0]), rung), balls, work)
    assert answer.time == pytest.approx(free.min(), rel=1e-9, abs=1e-12)
    assert answer.go == (answer.time > work.stop_time[100])
    assert answer.evaluations < free.size


@pytest.mark.parametrize("rung", ["reach", "reach32"])
def test_a_sweep_by_reach_finds_the_earliest_pair(load, panda, work, balls, rung):
    rivals, sweeps = load("scene.rivals"), load("scene.sweeps")
    free, workspace = compute_pair_times(panda, balls, work)
    earliest = np.maximum(free, workspace).min()
    answer = watch(rivals.Sweep(work, len(balls[0]), rung), balls, work)
    assert earliest * (1.0 - 2.0 * sweeps.NEARLY) <= answer.time <= earliest * (1.0 + 1e-9)
    assert answer.evaluations < free.size


def test_a_ball_of_unknown_place_is_a_contact(load, work, balls):
    rivals = load("scene.rivals")
    for rung in ("spheres", "bounds", "reach", "reach32"):
        position, velocity, stamps = (array.copy() for array in balls)
        position[17] = np.nan
        answer = watch(rivals.Sweep(work, len(stamps), rung), (position, velocity, stamps), work)
        assert answer.time == 0.0


def test_single_precision_survives_a_new_epoch(load, panda, work):
    crowds, rivals, sweeps = load("scene.crowds"), load("scene.rivals"), load("scene.sweeps")
    crowd = crowds.Crowd(50, 2.0, 100.0)
    double, single = (rivals.Sweep(work, 50, rung) for rung in ("reach", "reach32"))
    ticks = int(2.5 * sweeps.EPOCH * crowds.RATE)
    for tick in range(0, ticks, 41):
        rows = slice(0, 50) if tick == 0 else slice(tick % 50, tick % 50 + 1)
        measured = crowd.sample(rows, tick / crowds.RATE)
        times = []
        for sweep in (double, single):
            sweep.update(rows, None, tick / crowds.RATE, *measured)
            sweep.step(tick / crowds.RATE, work.q[0], work.v[0], 0.1)
            times.append(sweep.read().time)
        assert times[1] == pytest.approx(times[0], rel=3.0 * sweeps.NEARLY, abs=1e-12)


@pytest.mark.parametrize("name", ["Pinocchio, hulls", "MuJoCo, distances"])
def test_distances_are_those_of_the_true_geometry(load, panda, work, name):
    crowds = load("scene.crowds")
    contestant = make(load, work, name, 5)
    random = np.random.default_rng(1)
    position = random.uniform((-1.0, -1.0, 1.0), (1.0, 1.0, 3.0), (5, 3))
    balls = position, np.zeros((5, 3)), np.full(5, 0.1)
    answer = watch(contestant, balls, work)
    kinematics = Kinematics(panda)
    kinematics.compute(work.q[100], work.v[100])
    exact = HullDistance(panda, kinematics)
    nearest = min(
        exact.distance(link, position[k : k + 1], RADIUS)[0]
        for link in range(len(panda.links))
        for k in range(5)
    )
    distance = answer.time * (work.top_speed + crowds.SPEED)
    assert distance == pytest.approx(nearest, abs=1e-4)


@pytest.mark.parametrize("name", ["Coal, broad phase", "MuJoCo, contacts"])
def test_a_broad_phase_sees_what_is_too_near(load, work, name):
    far, near = np.array([[0.0, 9.0, 1.0]] * 4), np.array([[0.0, 9.0, 1.0]] * 4)
    near[2] = (0.0, 1.0, 0.6)
    for position, go in ((far, True), (near, False)):
        balls = position, np.zeros((4, 3)), np.full(4, 0.1)
        assert watch(make(load, work, name, 4), balls, work).go is go


def make(load, work, name, count):
    """A contestant by its name; skips where it cannot take part."""
    crowds, rivals = load("scene.crowds"), load("scene.rivals")
    kind, arguments = next(entry[3:] for entry in rivals.CONTESTANTS if entry[0] == name)
    try:
        return kind(work, count, *arguments)
    except crowds.UnavailableError as reason:
        pytest.skip(str(reason))


def test_the_crowd_keeps_its_distance_and_its_bounds(load, work):
    crowds = load("scene.crowds")
    crowd = crowds.Crowd(200, work.find_clearance(0.01), 100.0)
    assert crowd.group_count == 10
    seen = set()
    for tick in range(1, 11):
        rows, names, position, velocity = crowd.measure(tick)
        assert len(names) == len(position) == len(velocity)
        seen.update(range(rows.start, rows.stop))
    assert seen == set(range(200))
    for time in np.linspace(0.0, 20.0, 50):
        position, velocity = crowd.sample(slice(0, 200), time)
        after, _ = crowd.sample(slice(0, 200), time + 1e-6)
        assert np.allclose((after - position) / 1e-6, velocity, atol=1e-4)
        assert (np.hypot(*position.T[:2]) >= crowd.nearest).all()
        assert (np.linalg.norm(velocity, axis=1) <= crowds.SPEED).all()


def test_a_short_run(load, capsys):
    benchmark, rivals = load("bench_schedules"), load("scene.rivals")
    short = {"obstacles": 3, "turns": 2, "ticks": 3, "warm": 3, "patience": 0.2}
    # Those of one kind have the rest in common, and each monitor takes its time to compile.
    chosen = ("deadline, joint", "sweep, reach", "Pinocchio, hulls", "Coal, broad phase", "MuJoCo")
    options = [f"--{option}={value}" for option, value in short.items()]
    benchmark.main([*options, "--only", *chosen])
    lines = capsys.readouterr().out.splitlines()
    names = [name for name, *_ in rivals.CONTESTANTS if name.startswith(chosen)]
    assert len(names) >= len(chosen)
    for name in names:
        (told,) = (line for line in lines if line.startswith((f"{name}:", f"{name} ")))
        if not told.startswith(f"{name}: not available"):
            assert told.endswith("GO"), told
            median = float(told[len(name) :].split()[1].replace(",", ""))
            assert 0.0 < median < math.inf
    assert "deadline, joint" in "".join(lines)


def test_a_short_run_on_awareness(load, capsys, monkeypatch):
    benchmark = load("bench_awareness")
    monkeypatch.setattr(benchmark, "LADDER", (60,))
    benchmark.main(["--ticks=200", "--speed=0.5"])
    rows = {}
    for line in capsys.readouterr().out.splitlines():
        name = line[:24].strip()
        rows[name] = line[24:].split()
    titles = dict(zip(benchmark.COLUMNS, range(len(benchmark.COLUMNS)), strict=True))
    names = ["full", "deadline"]
    names += [
        f"daa, {law}, {sort}" for law in ("powers", "fibonacci") for sort in ("partial", "total")
    ]
    for name in names:
        cells = [
            float(rows[name][titles[title]]) for title in ("complete %", "answer", "evaluated")
        ]
        # Whatever a schedule has not looked at lately, its certificates never promise too much.
        assert cells[0] == 100.0
        assert 0.0 < cells[1] <= 1.0
        assert cells[2] <= float(rows["full"][titles["evaluated"]])
    assert rows["full"][:3] == ["100", "100", "0"]


def test_the_benchmark_beside_people_runs_and_nothing_in_it_is_refused(load, capsys):
    bench = load("bench_near")
    runs = bench.main(["--only", "at 1.1", "5,000", "--ticks", "30", "--turns", "1", "--warm", "5"])
    person, limited, crowd = runs
    assert not (person.refused | limited.refused | crowd.refused)
    assert len(person.steps) == len(limited.steps) == len(crowd.steps) == 30
    assert limited.obstacles.table.regions.any()
    assert not person.obstacles.table.regions[person.obstacles.table.alive].max() > 1
    assert crowd.levels[Level.STOP] == 30
    assert person.levels[Level.SLOW] == 30
    # Most of what is known of them lasts: fewer than a single evaluation of each pair.
    assert np.mean(person.evaluated) < 9 * len(person._swing.robot.links)
    assert np.mean(crowd.evaluated) < 500
    table = capsys.readouterr().out
    assert all(run.name in table for run in runs)


@pytest.mark.parametrize(("name", "path"), [("half speed", 2.4), ("0.35", 1.5)])
def test_an_arm_that_takes_the_speed_scale_as_its_override_moves_smoothly(load, name, path):
    bench = load("bench_scale")
    (scene,) = (one for title, one in bench.SCENES.items() if name in title)
    score = bench.run(scene, 6.0, 0.0, scale_rise=1.0)
    assert score.contacts == score.full == 0.0
    assert score.slow > 0.5
    assert score.reversals <= 2.5  # at most 2 in 15 s; a short run may begin or end in a swing
    assert score.jumps <= 4
    assert score.stops == 0.0
    # A scale that is raised as soon as a higher one is proved reverses 17 to 21 times a second.
    assert score.path > path


def test_rays_end_at_the_nearest_ball(load):
    bench = load("bench_cloud")
    camera = bench.Camera((1.0, -2.0, 0.5), (0.0, 0.3, 0.2), 1.2, 24, 18)
    random = np.random.default_rng(3)
    balls = np.column_stack(
        [camera.place + 1.5 * random.normal(size=(60, 3)), random.uniform(0.02, 0.3, 60)]
    )
    expected, hits = [], 0
    for ray in camera.rays:
        depth = bench.BACKGROUND
        for *center, radius in balls:
            offset = np.array(center) - camera.place
            if offset @ camera.forward <= 2.0 * radius:  # too near for the camera
                continue
            roots = np.roots([ray @ ray, -2.0 * ray @ offset, offset @ offset - radius**2])
            if np.isreal(roots).all():
                depth = min(depth, roots.min().real)
        expected.append(camera.place + depth * ray)
        hits += depth < bench.BACKGROUND
    assert 0.2 < hits / len(camera.rays) < 0.9
    points = camera.cast(balls)
    assert np.abs(points - expected).max() < 1e-9
    assert camera.find_foreground(points).sum() == hits
