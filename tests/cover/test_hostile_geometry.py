"""Meshes as they come: with holes, doubled, torn, inside out. Covered all the same, or refused."""

import coal
import numpy as np
import pytest

from armguard.cover import Cover
from armguard.cover.signed_distance import compute_signed_distances
from armguard.cover.triangulation import triangulate
from armguard.exceptions import CoverError
from support.one_link import OneLink
from support.surface_samples import is_inside, sample

BOX = triangulate("box", coal.Box(0.24, 0.1, 0.08))


def make_tube():
    """A box with a smaller one inside, wound the other way: a shell with a closed cavity."""
    return np.concatenate([BOX, 0.8 * BOX[:, ::-1]])


HOSTILE = {
    "hole": BOX[1:],
    "two holes": BOX[2:-1],
    "duplicate faces": np.concatenate([BOX, BOX[:5], BOX]),
    "inverted winding": BOX[:, ::-1],
    "mixed winding": np.concatenate([BOX[:6], BOX[6:, ::-1]]),
    "degenerate triangles": np.concatenate(
        [
            BOX,
            np.repeat(BOX[:3, :1], 3, axis=1),
            np.stack([BOX[:, 0], BOX[:, 1], 0.5 * (BOX[:, 0] + BOX[:, 1])], axis=1),
            np.stack([BOX[:, 0], BOX[:, 1], BOX[:, 1] + 1e-13], axis=1),
        ]
    ),
    "intersecting parts": np.concatenate([BOX, BOX + np.array([0.05, 0.03, 0.02])]),
    "parts apart": np.concatenate([BOX, 0.2 * BOX + np.array([0.0, 0.3, 0.0])]),
    "shell": make_tube(),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_every_surface_is_covered_at_every_level(name):
    link = OneLink(HOSTILE[name])
    cover = Cover.fit(link, spheres=4)
    assert cover.check(link).proved
    points = sample(HOSTILE[name], 20_000)
    for level in range(cover.levels("link")):
        assert is_inside(points, cover.spheres("link", level)).all()


@pytest.mark.parametrize(
    "name", ["duplicate faces", "inverted winding", "degenerate triangles", "shell"]
)
def test_a_solid_that_is_badly_made_needs_no_more_spheres(name):
    reports = [
        Cover.fit(OneLink(triangles), protrusion=0.05).check(OneLink(triangles))
        for triangles in (BOX, HOSTILE[name])
    ]
    assert reports[1].count <= reports[0].count + 1
    assert reports[1].max_protrusion <= 0.0501
    assert reports[1].volume_ratio == pytest.approx(reports[0].volume_ratio, rel=0.25)


def test_a_closed_cavity_is_inside_and_only_what_can_be_touched_counts():
    shell, middle = make_tube(), np.zeros((1, 3))
    assert compute_signed_distances(middle, shell)[0] == pytest.approx(-0.04)
    # Without its two ends, it is a tube that is open on both sides.
    is_side = np.ptp(shell[:, :, 0], axis=1) > 1e-9
    assert compute_signed_distances(middle, shell[is_side])[0] == pytest.approx(0.032)


@pytest.mark.parametrize("scale", [1000.0, 50.0, 0.001])
def test_implausible_sizes_are_refused_by_name(scale):
    link = OneLink(scale * BOX)
    with pytest.raises(CoverError, match=r"link 'link': is .* m across; expected .*scale"):
        Cover.fit(link)
