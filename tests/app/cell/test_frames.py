import numpy as np
import pytest

from armguard.app.cell.frames import place_bodies, read_rotation, resolve_frames
from armguard.app.cell.schema import parse_cell
from armguard.exceptions import CellError
from support.cell_texts import FRAMES, ROBOT


def resolve(text):
    return resolve_frames(parse_cell(text, "cell"), "cell")


def place(text):
    return place_bodies(parse_cell(text, "cell").statics, "statics", resolve(text), "cell")


def test_chains_of_frames_are_resolved_in_any_order():
    frames = resolve(FRAMES)
    assert set(frames) == {"world", "base", "lens", "camera"}
    # base: turned by a quarter about z; camera: turned over about x.
    np.testing.assert_allclose(frames["camera"].translation, [1.0, 2.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(frames["lens"].translation, [1.0, 2.0, -0.5], atol=1e-15)
    np.testing.assert_allclose(frames["lens"].apply([1.0, 2.0, 3.0]), [3.0, 3.0, -3.5], atol=1e-15)
    assert frames["lens"].calibration_error == pytest.approx(0.012)


def test_statics_stand_in_their_frame_and_grow_by_its_error():
    here = "radius = 0.1\nposition = [1, 2, 3]\n"
    placed = place(f'{FRAMES}[statics.post]\n{here}[statics.lamp]\nframe = "lens"\n{here}')
    np.testing.assert_allclose(placed["post"][0], [1.0, 2.0, 3.0])
    np.testing.assert_allclose(placed["lamp"][0], [3.0, 3.0, -3.5], atol=1e-15)
    assert placed["post"][1] == 0.1
    assert placed["lamp"][1] == pytest.approx(0.112)


@pytest.mark.parametrize(
    ("table", "key", "pattern"),
    [
        ("[frames.base]", "frames.base", "frame of its own"),
        ("[frames.pole]\nparent = 'moon'", "frames.pole.parent", "'moon'.*one of world, base"),
        ("[frames.pole]\nparent = 'pole'", "frames.pole.parent", r"circle \(pole in pole\)"),
        ("[frames.pole]\nquaternion = [0, 0, 0, 2]", "frames.pole.quaternion", "of length 2"),
        ("[statics.lamp]\nradius = 1", "statics.lamp", "not exactly one of position and points"),
        (
            "[statics.lamp]\nradius = 1\nframe = 'moon'\nposition = [0, 0, 0]",
            "statics.lamp.frame",
            "'moon'.*one of world, base",
        ),
    ],
)
def test_what_cannot_be_placed_is_named(table, key, pattern):
    with pytest.raises(CellError, match=pattern) as caught:
        place(f"{ROBOT}{table}")
    assert caught.value.offender == f"cell: {key}"


@pytest.mark.parametrize("length", [1.0 + 0.9e-3, 1.0 - 0.9e-3])
def test_quaternions_are_made_unit_when_nearly_so(length):
    rotation = read_rotation("key", (0.0, 0.0, 0.6 * length, 0.8 * length), "cell")
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)


@pytest.mark.parametrize("length", [0.0, 1.01, 0.99, np.nan, np.inf])
def test_any_other_quaternion_is_refused(length):
    with pytest.raises(CellError, match=r"cell: key.*of length 1"):
        read_rotation("key", (0.0, 0.0, 0.0, length), "cell")
