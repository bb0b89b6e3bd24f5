"""Import of the published tongue: its numbers, directions, stored shapes and refusals."""

import shutil

import numpy as np
import pytest

from benchmarks.tongue import published as with_recorded_directions
from emgface.anatomy.tongue.model import attached_nodes
from emgface.anatomy.tongue.published import TURN, import_tongue, read_gesture
from emgface.anatomy.tongue.scene import segment_forces
from emgface.errors import TongueError
from emgface.face.quality import element_quality


def test_the_published_numbers_are_found(published):
    """Those of the specification: sizes, volume, mass, quality, forces, attachments, left is x < 0."""
    assert (published.sizes["node"], published.sizes["element"]) == (946, 740)
    assert published.sizes["bundle_element"] == 874
    quality = element_quality(published["position"].values, published["connectivity"].values)
    assert quality.volume.sum() == pytest.approx(1.02292e-4, rel=1e-5)
    assert 1040.0 * quality.volume.sum() == pytest.approx(0.1064, abs=5e-5)
    assert quality.scaled_jacobian.min() == pytest.approx(0.0072, abs=5e-5)
    force = published["muscle_force_max"].sel(muscle=["GGP_L", "SL", "HG_R"])
    assert force.values.tolist() == [18.5, 19.0, 32.5]
    numbers = {body: len(nodes) for body, nodes in attached_nodes(published).items()}
    assert numbers == {"jaw": 59, "hyoid": 56}
    left = [str(name).endswith("_L") for name in published["muscle"].values]
    own = published["bundle_index"].values[np.array(left)[published["bundle_muscle"].values]]
    assert (
        published["position"].values[published["connectivity"].values[own], 0].mean(1).max() < 0.0
    )


def test_directions_and_segment_forces_are_those_of_the_other_program(shared, published):
    """Except for GGP and STY, where that program takes the directions of other segments, and for two
    elements of SL whose centre has four equidistant midpoints.
    """
    recorded = with_recorded_directions(shared, "tongue/model_element")
    dot = np.abs((recorded["bundle_direction"] * published["bundle_direction"]).sum("axis").values)
    apart = np.degrees(np.arccos(np.clip(dot, 0.0, 1.0)))
    names = published["muscle"].values[published["bundle_muscle"].values]
    other = np.array([name[:3] in ("GGP", "STY") for name in names])
    assert np.quantile(apart[~other], 0.99) < 1e-5
    assert apart[~other].max() < 0.3
    assert apart[other].max() > 20.0
    force, fibre = segment_forces(published), published["fibre_of_point"].values
    muscle = published["fibre_muscle"].values[fibre]
    within = np.append(fibre[1:] == fibre[:-1], False)
    with np.load(shared / "artisynth_reference" / "tongue" / "model_line.npz") as arrays:
        for k, name in enumerate(published["muscle"].values):
            theirs = arrays[f"tongue_bundle_{name}_fibre_max_force"]  # in single precision
            np.testing.assert_allclose(force[within & (muscle == k)], theirs, rtol=1e-7)


def test_stored_shapes_have_the_published_sizes(published):
    """Median, largest and tip displacement of the specification [mm], in the published frame."""
    for name, median, largest, tip in (
        ("rest", 1.18, 3.58, (2.29, 0.06, 1.55)),
        ("i", 4.53, 7.61, (-2.40, -0.10, 4.96)),
        ("jaw_open_a", 3.69, 5.44, (-1.06, 0.0, -5.34)),
    ):
        d = 1e3 * published["posture_displacement"].sel(posture=name).values @ TURN
        size = np.linalg.norm(d, axis=1)
        assert (np.median(size), size.max()) == pytest.approx((median, largest), abs=6e-3)
        np.testing.assert_allclose(d[int(published["marker_node"][0])], tip, atol=6e-3)


def test_a_stored_shape_can_be_at_rest(shared, published):
    at_rest = import_tongue(shared / "artisynth_models" / "tongue", rest="rest_il01")
    expected = published["position"].values + [0.0, -2e-3, 0.0]
    expected = expected + published["posture_displacement"].sel(posture="rest_il01").values
    np.testing.assert_allclose(at_rest["position"], expected, atol=1e-12)
    d = at_rest["posture_displacement"].sel(posture="rest_il01")
    assert np.abs(d.values).max() == 0.0


def test_incomplete_folders_and_unknown_options_are_refused(shared, tmp_path):
    folder = shared / "artisynth_models" / "tongue"
    with pytest.raises(TongueError, match="tongue.node of the published tongue not found"):
        import_tongue(tmp_path)
    with pytest.raises(TongueError, match="forces = 'weak', expected one of standard, strong"):
        import_tongue(folder, forces="weak")
    with pytest.raises(TongueError, match="no stored shape 'u'"):
        import_tongue(folder, rest="u")
    own = shutil.copytree(folder, tmp_path / "tongue")
    (own / "derived").chmod(0o755)
    (own / "derived" / "muscle_elements.csv").unlink()
    with pytest.raises(TongueError, match="muscle_elements.csv of the published tongue not found"):
        import_tongue(own)


def test_a_published_gesture_is_read_by_its_columns(tmp_path):
    path = tmp_path / "excitations.txt"
    rows = [[0.0] * 12, [0.5, -2e-17, *np.linspace(0.1, 0.9, 9), 1.0]]
    text = "\n".join(" ".join(map(str, row)) for row in rows)
    path.write_text(f"0.1 1.1 2.0\nLinear 11 explicit\n{text}\n")
    gesture = read_gesture(path)
    np.testing.assert_allclose(gesture.time, [0.1, 1.1])
    assert gesture.values["bi_GGP"].tolist() == [0.0, 0.0] and gesture.values["SL"][1] == 1.0
    assert gesture.values["bi_GGM"][1] == pytest.approx(0.1)
    for bad, why in (
        ("0 1 1\nLinear 12 explicit\n" + text, "Linear 12"),
        ("0 1 1\nLinear 11 explicit\n" + text.replace("1.0", "1.5"), "from -2e-17 to 1.5"),
        ("0 1 1\nLinear 11 explicit\n0 1 2", "3 numbers"),
    ):
        path.write_text(bad)
        with pytest.raises(TongueError, match=why):
            read_gesture(path)
