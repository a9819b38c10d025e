"""Every demo runs headless, and what the demos claim is so."""

import importlib.util
import inspect
import re
from pathlib import Path

import numpy as np
import pytest

from armguard.exceptions import ArmguardError

DEMOS = sorted((Path(__file__).parents[2] / "demos").glob("[0-9][0-9]_*.py"))

# Arguments of `main` that make a demo short, and those that name sockets, kept from real ones.
QUICK = {"seeds": 20, "duration": 0.3}
SOCKETS = {"address", "joints", "verdicts", "obstacles"}

# Demos that need what not every machine has.
NEEDS = {"05_mujoco": "mujoco"}


def load_demo(path):
    specification = importlib.util.spec_from_file_location(f"demo_{path.stem}", path)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.mark.parametrize("path", DEMOS, ids=lambda path: path.stem)
def test_every_demo_has_a_title_and_a_main_that_runs(path, capsys, tmp_path):
    if path.stem in NEEDS:
        pytest.importorskip(NEEDS[path.stem])
    demo = load_demo(path)
    assert capsys.readouterr().out == "", "importing a demo must not run it"
    assert inspect.getdoc(demo).splitlines()[0].endswith(".")
    parameters = inspect.signature(demo.main).parameters
    assert all(one.default is not one.empty for one in parameters.values())
    arguments = {name: value for name, value in QUICK.items() if name in parameters}
    arguments |= {name: f"ipc://{tmp_path}/{name}" for name in SOCKETS & set(parameters)}
    demo.main(**arguments)


def test_in_mujoco_a_supervised_arm_touches_nothing_while_it_moves_and_another_does():
    """MuJoCo measures the distances, knowing nothing of armguard's."""
    pytest.importorskip("mujoco")
    demo = load_demo(next(path for path in DEMOS if path.stem == "05_mujoco"))
    supervised, free = (demo.main(6.0, is_obeying=one) for one in (True, False))
    assert supervised.least_moving_distance > 0.0
    assert supervised.path > 0.1
    assert {"SLOW", "STOP"} <= set(supervised.levels)
    assert free.least_moving_distance < 0.0, "else there is nothing to be stopped for"


@pytest.fixture(scope="module")
def paper():
    return load_demo(next(path for path in DEMOS if path.stem == "02_paper"))


def smallest_root(x, v, contact_distance, accel):
    """First time on the paper's quartic, by the eigenvalues of its companion matrix, in [s]."""
    roots = np.roots(
        [
            -(accel**2) / 4,
            0.0,
            v @ v - contact_distance * accel,
            2 * (v @ x),
            x @ x - contact_distance**2,
        ]
    )
    return min(root.real for root in roots if abs(root.imag) < 1e-9 and root.real > 0)


def test_sample_two_gives_the_published_times_with_the_published_bounds(paper):
    _, contact_time = paper.compute_pairs(paper.SAMPLE_POSITION, paper.SAMPLE_VELOCITY)
    assert f"{paper.PAIR_ACCEL[0]:.2f} {paper.PAIR_ACCEL[1]:.2f}" == "1.20 2.31"
    assert f"{contact_time[0]:.2f}" == paper.PUBLISHED_CONTACT_TIME[0]
    assert f"{contact_time[1]:.1f}" == paper.PUBLISHED_CONTACT_TIME[1]


def test_contact_times_of_the_world_are_the_smallest_roots_of_the_quartic(paper):
    states = [(paper.SAMPLE_POSITION, paper.SAMPLE_VELOCITY)]
    for seed in range(20):
        states += zip(*paper.draw_motion(seed), strict=True)
    for position, velocity in states:
        distance, contact_time = paper.compute_pairs(position, velocity)
        for pair, (i, j) in enumerate(zip(paper.FIRST, paper.SECOND, strict=True)):
            x, v = position[j] - position[i], velocity[j] - velocity[i]
            assert distance[pair] == pytest.approx(np.linalg.norm(x))
            expected = smallest_root(x, v, 2 * paper.RADIUS, paper.PAIR_ACCEL[pair])
            assert contact_time[pair] == pytest.approx(expected, rel=1e-7)


def test_random_motions_keep_to_their_bounds_and_apart(paper):
    for seed in range(50):
        position, velocity = paper.draw_motion(seed)
        assert position.shape == velocity.shape == (paper.ITERATIONS + 1, 3, 2)
        change = np.linalg.norm(np.diff(velocity, axis=0), axis=-1)
        assert (change <= paper.OBJECT_ACCEL * paper.PERIOD * (1 + 1e-12)).all()
        assert (paper.compute_pairs(position, velocity)[0] > 2 * paper.RADIUS).all()
        # Displacements over a period follow from the velocities at both of its ends.
        mean = (velocity[1:] + velocity[:-1]) / 2
        np.testing.assert_allclose(np.diff(position, axis=0), mean * paper.PERIOD, atol=1e-12)


def test_agreement_is_a_count_of_iterations_and_awareness_agrees_with_itself_best(paper):
    agreement = paper.compute_agreement(60)
    assert list(agreement) == list(paper.PUBLISHED_AGREEMENT)
    for counts in agreement.values():
        assert counts.shape == (60,)
        assert counts.min() >= 0
        assert counts.max() <= paper.ITERATIONS
    means = [counts.mean() for counts in agreement.values()]
    assert means[0] > max(means[1:])


def test_the_references_name_the_smallest_value_of_each_iteration(paper):
    distance, contact_time = paper.compute_pairs(*paper.draw_motion(3))
    for schedule, values in [
        (paper.FullSchedule(), contact_time),
        (paper.DistanceSchedule(), distance),
    ]:
        named = paper.name_most_imminent(schedule, values)
        assert named.tolist() == values[1:].argmin(axis=1).tolist()


def test_the_paper_prints_its_figures_beside_ours(paper, capsys):
    paper.main(seeds=5)
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines())) <= 100
    for row in (
        "1-2 .* 1.20 .* 0.950 .* 0.95",
        "1-3 .* 2.31 .* 3.100 .* 3.1",
        "DAA and full-DAA +20",
    ):
        assert re.search(row, printed)


def test_no_worlds_are_refused(paper):
    with pytest.raises(ArmguardError, match="1 or more"):
        paper.main(seeds=0)
