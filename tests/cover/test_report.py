import coal
import numpy as np
import pytest

from armguard.cover import CoverReport, LinkReport
from armguard.cover.report import report_link
from armguard.cover.sphere_tree import SphereTree
from armguard.cover.triangulation import triangulate


def test_a_cube_in_a_ball_is_measured_as_geometry_says():
    cube = triangulate("cube", coal.Box(2.0, 2.0, 2.0))
    radius = 1.001 * np.sqrt(3.0)
    tree = SphereTree(np.array([[0.0, 0.0, 0.0, radius]]), np.zeros(1, int), np.zeros(1, int))
    report = report_link(tree, cube)
    assert report.proved
    assert report.count == 1
    assert report.max_protrusion == pytest.approx(radius - 1.0)
    assert report.area == pytest.approx(4.0 * np.pi * radius**2)
    assert report.union_volume == pytest.approx(4.0 / 3.0 * np.pi * radius**3, rel=0.02)
    assert report.link_volume == pytest.approx(8.0, rel=0.15)  # a coarse grid
    assert not report_link(tree._replace(spheres=tree.spheres * 0.99), cube).proved


def test_a_report_sums_up_its_links():
    good = LinkReport(True, 3, 0.02, 0.01, 2.0, 6.0, 2.0)
    bad = LinkReport(False, 4, 0.05, 0.03, 1.0, 4.0, 0.0)
    report = CoverReport({"good": good, "bad": bad})
    assert not report.proved
    assert CoverReport({"good": good}).proved
    assert (report.count, report.max_protrusion) == (7, 0.05)
    assert report.mean_protrusion == pytest.approx(0.05 / 3.0)
    assert report.volume_ratio == pytest.approx(5.0)
    assert bad.volume_ratio == np.inf
