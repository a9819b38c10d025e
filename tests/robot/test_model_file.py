from armguard.robot.model_file import is_mjcf, read_model
from support.mjcf_arms import write_mjcf
from support.urdf_arms import two_links


def test_the_root_element_tells_formats_apart(tmp_path):
    mjcf, urdf = write_mjcf(tmp_path), two_links(tmp_path)
    assert is_mjcf(mjcf)
    assert list(read_model(mjcf).model.names)[1:3] == ["pan", "lift"]
    assert list(read_model(urdf).model.names)[1:] == ["shoulder"]
    broken = tmp_path / "broken.xml"
    broken.write_text("<mujoco")
    for path in (urdf, broken, tmp_path, tmp_path / "none.xml"):
        assert not is_mjcf(path)
