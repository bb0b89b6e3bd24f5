"""The imported model compared with that of another program and with published tables."""

import json

import numpy as np
import pytest

from emgface.anatomy.jaw.published import import_jaw
from emgface.errors import JawError
from tests.jaw.conftest import TO_MM, here


@pytest.mark.parametrize("variant", ["fixed", "larynx"])
def test_parts_are_those_of_the_program(shared, published, variant):
    """Masses, inertia, lines, parameters, planes and exciters, as the program reports them."""
    jaw = published(variant, values="program")
    folder = shared / "artisynth_reference" / "jaw"
    model = json.loads((folder / f"model_{variant}.json").read_text())
    moving = [b for b in model["bodies"] if b["dynamic"]]
    assert [str(n) for n in jaw["body"][jaw["body_moves"] == 1].values] == [
        b["name"] for b in moving
    ]
    for body in moving:
        row, signs = jaw.sel(body=body["name"]), np.sign(TO_MM)
        assert float(row["body_mass"]) == body["mass_kg"]
        np.testing.assert_allclose(row["body_centre"] * TO_MM, body["com_body_mm"], atol=1e-12)
        inertia = row["body_inertia"] * 1e6 * np.outer(signs, signs)
        np.testing.assert_allclose(inertia, body["inertia_about_com_kgmm2"], rtol=1e-12)
        assert float(row["body_damping"]) == body["frame_damping_kg_s"]
        assert float(row["body_turn_damping"]) * 1e6 == pytest.approx(
            body["rotary_damping_kgmm2_s"]
        )

    assert jaw.sizes["muscle"] == len(model["muscles"]) == {"fixed": 24, "larynx": 40}[variant]
    for muscle in model["muscles"]:
        row, stated = jaw.sel(muscle=here(muscle["name"])), muscle["material_properties"]
        ends = row["muscle_position"].values * TO_MM
        np.testing.assert_allclose(ends, [muscle["p1_world"], muscle["p2_world"]], atol=1e-9)
        length = np.linalg.norm(ends[1] - ends[0])
        assert float(row["muscle_force_max"]) * 1e3 == pytest.approx(stated["maxForce"], rel=1e-11)
        assert length * float(row["muscle_stretch_max"]) == pytest.approx(stated["maxLength"])
        assert float(row["muscle_tendon_ratio"]) == stated["tendonRatio"]
        assert float(row["muscle_passive_fraction"]) == stated["passiveFraction"]
        assert float(row["muscle_damping"]) == stated["damping"]

    lengths_of_parts = [
        np.sort(np.linalg.norm(np.diff(jaw["spring_position"] * 1e3, axis=1), axis=2).ravel()),
        np.sort(jaw["spring_rest_length"] * 1e3),
    ]
    springs = model["springs"]
    for lengths, key in zip(lengths_of_parts, ("length_mm", "rest_length_mm"), strict=True):
        np.testing.assert_allclose(lengths, sorted(s[key] for s in springs), rtol=1e-9)

    groups = model["exciters"]

    def muscles_of(name):
        if name not in groups:
            return {here(name)}
        return {m for part in groups[name] for m in muscles_of(part)}

    known = {str(n) for n in jaw["exciter"].values}
    for name in groups:
        driven = set()
        if here(name) in known:
            gain = jaw.sel(exciter=here(name))["exciter_gain"]
            driven = {str(m) for m in jaw["muscle"].values[gain.values == 1.0]}
        assert driven == muscles_of(name), name


@pytest.mark.parametrize("variant", ["fixed", "larynx"])
def test_walls_and_joints_lie_where_the_program_has_them(shared, published, variant):
    jaw = published(variant, values="program")
    folder = shared / "artisynth_reference" / "jaw"
    model = json.loads((folder / f"model_{variant}.json").read_text())
    words = {"TMJ": "tmj", "BITE": "bite", "POST": "posterior", "LTRL": "lateral"}
    checked = 0
    for connector in model["connectors"]:
        name = connector["name"]
        if not connector["enabled"] or name == "cricothyroid":
            continue
        row = jaw.sel(joint=words[name[1:]] + f"_{name[0]}")
        at = row["joint_origin"].values * TO_MM
        np.testing.assert_allclose(at, connector["frame_D_origin_world_mm"], atol=1e-9)
        assert bool(row["joint_one_sided"]) == connector["unilateral"]
        checked += 1
        if "segment_points" in connector:  # corners of strips that follow the curve
            corners = np.array([p["world"] for p in connector["segment_points"]])
            s = (at[1] - corners[:, 1]) * 1e-3
            depth = np.polynomial.polynomial.polyval(s, row["joint_curve"].values) * 1e3
            np.testing.assert_allclose(at[2] - depth, corners[:, 2], atol=1e-9)
            continue
        normal = row["joint_normal"].values * np.sign(TO_MM)
        np.testing.assert_allclose(normal, connector["normal_world_D_z"], atol=1e-9)
    assert checked == 8


def test_values_of_the_text_have_published_masses_and_inertia_of_the_surfaces(published):
    """Section 2.2 of the publication: thyroid 24 g, cricoid 23 g; the mandible has 3470 kg/m3."""
    jaw = published("larynx")
    mass = {str(n): float(m) for n, m in zip(jaw["body"].values, jaw["body_mass"], strict=True)}
    assert (mass["jaw"], mass["thyroid"], mass["cricoid"]) == (0.2, 0.024, 0.023)
    inertia = jaw["body_inertia"].sel(body="jaw").values * 1e6
    np.testing.assert_allclose(np.diag(inertia), [147.4, 246.1, 297.4], atol=0.06)
    assert inertia[1, 2] == pytest.approx(45.0, abs=0.06)  # y points forward here


def test_sides_are_those_of_the_subject_and_mirror_images(published):
    jaw = published("larynx")
    names = [str(n) for n in jaw["muscle"].values]
    position = jaw["muscle_position"].values
    for k, name in enumerate(names):
        if name.endswith("_L"):
            assert (position[k, :, 0] < 0.0).all()  # +x is the subject's right
            other = names.index(name[:-2] + "_R")
            np.testing.assert_array_equal(position[other], position[k] * [-1, 1, 1])
    incisor = jaw["point_position"].sel(point="lower_incisor")
    condyle = jaw["point_position"].sel(point="condyle_L")
    assert incisor[1] > condyle[1] + 0.05  # the teeth are in front


def test_bad_files_and_options_are_refused(tmp_path, shared):
    with pytest.raises(JawError, match=r"contains no muscleInfo\.txt"):
        import_jaw(tmp_path)
    with pytest.raises(JawError, match=r"variant = 'both', expected one of"):
        import_jaw(tmp_path, variant="both")
    folder = shared / "artisynth_models" / "jaw_larynx"
    for name in folder.iterdir():
        if name.name != "landmarks":
            (tmp_path / name.name).symlink_to(name)
    with pytest.raises(JawError, match=r"jawFixedMarkers\.landmarkAscii contains no landmarks"):
        import_jaw(tmp_path)
