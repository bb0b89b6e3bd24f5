"""Resected jaws: closed forms, mass, scars, and plans in their order."""

import numpy as np
import pytest

import sim
from emgface.choices import configure
from emgface.errors import DataError
from emgface.treatment.plan import NOT_VALIDATED, Plan


def test_a_jaw_treated_twice_keeps_both_plans():
    from emgface.anatomy.jaw.template import template_jaw
    from emgface.face.identity import treatments, treatments_between
    from emgface.treatment.treat import treat_jaw

    def plan(side: str) -> Plan:
        step = {"kind": "resection", "side": side, "reconstruction": "plate"}
        return configure(Plan, {"name": side, "step": [step]})

    jaw = template_jaw()
    once = treat_jaw(jaw, plan("left"))
    twice = treat_jaw(once, plan("right"))
    assert [e["plan"]["name"] for e in treatments(twice)] == ["left", "right"]
    between = ((jaw, twice, 2), (once, twice, 1), (jaw, once, 1))
    assert [len(treatments_between(a, b)) for a, b, _ in between] == [n for *_, n in between]
    with pytest.raises(DataError, match="exchange both"):
        treatments_between(twice, once)
    kept = set(map(str, jaw["muscle"].values)) - set(map(str, twice["muscle"].values))
    assert {"at_L", "at_R"} <= kept  # both sides have lost theirs


def test_a_resection_of_the_jaw_is_mirrored_and_loses_muscles_and_joint(tmp_path):
    from emgface.anatomy.jaw.template import template_jaw
    from emgface.errors import JawError
    from emgface.schema.netcdf import read_netcdf, write_netcdf
    from emgface.schema.validation import validate
    from emgface.treatment.treat import treat_jaw

    jaw = template_jaw()
    left, right = (
        treat_jaw(jaw, configure(Plan, {"step": [{"kind": "resection", "side": side}]}))
        for side in ("left", "right")
    )
    names = {str(m) for m in left["muscle"].values}
    assert "mt_L" not in names and {"mt_R", "ad_L"} <= names
    assert "tmj_L" not in left["joint"].values and "tmj_R" in left["joint"].values
    scars = [np.char.startswith(j["spring"].values.astype(str), "scar") for j in (left, right)]
    ends = [j["spring_position"].values[s][:, 0] for j, s in zip((left, right), scars, strict=True)]
    assert (ends[0][:, 0] < 0.0).all()  # the left of the subject is -x
    np.testing.assert_allclose(ends[0] * [-1.0, 1.0, 1.0], ends[1], atol=1e-9)
    stored = read_netcdf(write_netcdf(left, tmp_path / "jaw.nc", "jaw_model"), "jaw_model")
    assert NOT_VALIDATED in stored.attrs["treatment"]
    validate(left, "jaw_model")
    with pytest.raises(JawError, match="applies to a face"):
        treat_jaw(jaw, configure(Plan, {"step": [{"kind": "palsy"}]}))


def test_the_clipped_part_of_a_surface_is_closed_and_has_its_closed_form():
    from emgface.treatment.resection import clipped

    # a brick of 4 x 2 x 3 about the origin; one corner lies exactly in the plane of a cut
    x, y, z = (np.array([-0.5, 0.5]) * size for size in (4.0, 2.0, 3.0))
    corners = np.array([[a, b, c] for a in x for b in y for c in z])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    for limit in (1.0, -0.5, 1.75):
        points, triangles = clipped(corners, faces, limit)
        part = sim.body_of_surface("brick", points, triangles, 1.0)  # refuses open surfaces
        length = 2.0 + abs(limit)
        assert part.mass == pytest.approx(6.0 * length)
        middle = np.sign(limit) * 0.5 * (abs(limit) - 2.0)
        np.testing.assert_allclose(part.centre, [middle, 0.0, 0.0], atol=1e-12)
        about = 6.0 * length / 12.0 * (np.array([2.0, length, length]) ** 2 + [9.0, 9.0, 4.0])
        np.testing.assert_allclose(part.inertia, np.diag(about), atol=1e-9)
    points, triangles = clipped(corners, faces, 2.0)  # a plane that only touches
    assert sim.body_of_surface("brick", points, triangles, 1.0).mass == pytest.approx(24.0)


def test_deviation_of_a_resected_jaw_grows_with_its_scar_at_equal_gape():
    from emgface.anatomy.jaw.template import template_jaw
    from emgface.errors import JawError
    from emgface.treatment.jaw_outcomes import (
        deviation_at,
        jaw_outcome_table,
        opened_by_muscles,
        resected_side,
    )
    from emgface.treatment.plan import Resection
    from emgface.treatment.resection import resect
    from emgface.treatment.treat import treat_jaw

    jaw = template_jaw()
    assert deviation_at((np.array([0.0, 2.0, 6.0]), np.array([0.0, 1.0, 3.0])), 5.0) == 2.5
    deviations = []
    for side, stiffness in (("left", 0.0), ("left", 800.0), ("right", 800.0)):
        one, _ = resect(jaw, Resection(side=side, scar_stiffness=stiffness))
        deviations.append(deviation_at(opened_by_muscles(one), 5.0))
    assert deviations[1] < deviations[0] < 0.0  # towards the resected side, -x
    assert deviations[2] == pytest.approx(-deviations[1], abs=0.02)
    with pytest.raises(JawError, match="molars of 0 sides"):
        resected_side(jaw)
    treated = treat_jaw(jaw, Plan(step=(Resection(hyoid="fixed"),)))
    assert not treated["body_moves"].sel(body="hyoid")
    table = jaw_outcome_table(jaw, treated).set_index("outcome")
    assert np.isfinite(table["after"]).all()
    assert table.loc["rest, incisor to the right", "before"] == pytest.approx(0.0, abs=0.05)


def test_a_resected_jaw_has_its_mass_in_the_bone_that_remains():
    from emgface.anatomy.jaw.template import template_jaw
    from emgface.treatment.plan import Resection
    from emgface.treatment.resection import ANTERIOR_CUT, resect

    jaw = template_jaw()
    treated, attributes = resect(jaw, Resection(side="left"))
    plate, _ = resect(jaw, Resection(side="left", reconstruction="plate"))
    body = {"body": "jaw"}
    assert float(treated["body_mass"].sel(body)) == float(jaw["body_mass"].sel(body))
    way = (treated["body_centre"] - jaw["body_centre"]).sel(body).values
    assert way[0] > 10e-3 and attributes["moved_centre_of_mass_mm"] == pytest.approx(
        1e3 * np.linalg.norm(way)
    )
    assert (np.linalg.eigvalsh(treated["body_inertia"].sel(body).values) > 0.0).all()
    np.testing.assert_array_equal(plate["body_centre"], jaw["body_centre"])
    number = list(map(str, treated["body"].values)).index("jaw")
    bone = treated["surface_position"].values[treated["surface_body"].values == number]
    limit = ANTERIOR_CUT * float(jaw["point_position"].sel(point="bite_L", axis="x"))
    assert bone[:, 0].min() == pytest.approx(limit)  # the bone ends at the cut
