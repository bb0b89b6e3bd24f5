"""Import of the published coupled head, against what the other program built from the same files."""

import json
from pathlib import Path

import numpy as np
import pytest

import sim
from emgface.anatomy.head.model import Head, read_head, write_head
from emgface.anatomy.head.published import import_head
from emgface.anatomy.head.run import raised, simulate_head
from emgface.anatomy.head.scene import head_scene
from emgface.anatomy.tongue.published import TURN
from emgface.errors import HeadError

TO_MM = 1e3


@pytest.fixture(scope="module")
def head(shared: Path) -> Head:
    return import_head(shared / "artisynth_models")


def test_geometry_attachments_and_bodies_are_those_recorded(head: Head, shared: Path) -> None:
    recorded = shared / "artisynth_reference" / "coupled" / "model_jhtface"
    model = json.loads(recorded.with_suffix(".json").read_text())["rigid"]
    with np.load(recorded.with_suffix(".npz")) as arrays:
        for part, name in (("face", "badinface_rest"), ("tongue", "tongue_rest")):
            X = TO_MM * head.parts[part]["position"].values @ TURN
            np.testing.assert_allclose(X, arrays[name][: len(X)], rtol=0, atol=1e-10)
        for pair, name in (
            ("face-jaw", "attach_badinface_to_jaw_nodes"),
            ("face-skull", "badinface_fixed"),
            ("tongue-jaw", "attach_tongue_to_jaw_nodes"),
            ("tongue-hyoid", "attach_tongue_to_hyoid_nodes"),
        ):
            assert set(head.attached(pair)) == set(arrays[name]), pair
    jaw = head.parts["jaw"]
    for body in (b for b in model["bodies"] if b["dynamic"]):
        own = jaw.sel(body=body["name"])
        assert float(own["body_mass"]) == pytest.approx(body["mass_kg"], rel=1e-5)
        inertia = 1e6 * TURN.T @ own["body_inertia"].values @ TURN  # kg mm2
        np.testing.assert_allclose(inertia, body["inertia_about_com_kgmm2"], rtol=1e-5, atol=1e-3)
    muscles = {m["name"]: m for m in model["muscles"]}
    ends = TO_MM * jaw["muscle_position"].values @ TURN
    assert jaw.sizes["muscle"] == 22  # gh, am and pm are replaced by muscles of the tongue
    for k, name in enumerate(map(str, jaw["muscle"].values)):
        theirs = muscles[name[-1].lower() + name[:-2]]
        np.testing.assert_allclose(ends[k], [theirs["p1_world"], theirs["p2_world"]], atol=1e-3)
        stretch = theirs["material_properties"]["optLength"] / theirs["length_mm"]
        assert float(jaw["muscle_stretch_opt"][k]) == pytest.approx(stretch, rel=1e-4)
    kinds = {"BITE": "bite", "POST": "posterior", "LTRL": "lateral", "TMJ": "tmj"}
    for joint in (c for c in model["connectors"] if c["enabled"]):
        own = jaw.sel(joint=f"{kinds[joint['name'][1:]]}_{joint['name'][0]}")
        at = TO_MM * own["joint_origin"].values @ TURN
        np.testing.assert_allclose(at, joint["frame_D_origin_world_mm"], atol=1e-3)
        across = own["joint_normal"].values @ TURN
        sign = -1.0 if joint["name"].endswith("TMJ") else 1.0  # of a path that holds both ways
        np.testing.assert_allclose(across, sign * np.array(joint["normal_world_D_z"]), atol=1e-9)


def test_floor_of_the_mouth_follows_the_tongue(shared: Path) -> None:
    """The 20 and 18 nodes of the lists keep their places; all are free in the published program."""
    floor = import_head(shared / "artisynth_models", ["face", "jaw", "tongue", "hyoid"], floor=True)
    sizes = {pair: len(floor.attached(pair)) for pair in ("face-tongue", "face-hyoid")}
    assert sizes == {"face-tongue": 20, "face-hyoid": 18}
    scene = head_scene(floor.touching([])).scene
    (attached,) = (m for m in scene.reductions if isinstance(m, sim.InElement))
    assert attached.embedding is not None
    x = np.einsum("na,nai->ni", attached.embedding.weights, scene.mesh.X[attached.embedding.nodes])
    np.testing.assert_allclose(x, scene.mesh.X[attached.nodes], rtol=0, atol=1e-12)


def test_hyoid_springs_have_the_stiffness_of_the_six_axis_spring(head: Head) -> None:
    """Force and moment of small displacements: 1760 N/m and 0.0412 N m/rad along and about each axis."""
    jaw = head.parts["jaw"]
    near, far = np.moveaxis(jaw["spring_position"].values, 1, 0)
    centre = jaw["body_centre"].sel(body="hyoid").values
    K = np.zeros((6, 6))
    for a, b, k in zip(near, far, jaw["spring_stiffness"].values, strict=True):
        along = (b - a) / np.linalg.norm(b - a)
        row = np.concatenate([along, np.cross(a - centre, along)])
        K += k * np.outer(row, row)
    np.testing.assert_allclose(K[:3, :3], 1760.0 * np.eye(3), atol=1e-9)
    np.testing.assert_allclose(K[3:, 3:], 4.123152e-2 * np.eye(3), atol=1e-12)
    np.testing.assert_allclose(K[:3, 3:], 0.0, atol=1e-9)


def test_parts_are_stored_and_move(shared: Path, tmp_path: Path) -> None:
    jaw = import_head(shared / "artisynth_models", ["jaw", "hyoid"])
    again = read_head(write_head(jaw, tmp_path / "head.nc"))
    assert again.lists.attrs["origin"] == "published geometry, imported"
    motion = simulate_head(again, raised({"bi_ad": 0.2, "bi_ip": 0.2}, rise=0.05), duration=0.1)
    down = motion["position"].sel(marker="lower_incisor", axis="z").values
    assert 1e3 * (down[0] - down[-1]) > 3.0


def test_absent_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(HeadError, match=r"badinmaxilla\.obj not found: specify the folder"):
        import_head(tmp_path, ["face"])
    with pytest.raises(HeadError, match="expected names of face, jaw"):
        import_head(tmp_path, ["nose"])
