"""Treated faces against closed forms, untreated faces and mirror images."""

import ast
import json
import pickle
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from scipy.spatial import KDTree

import emgface as ef
import sim
from emgface.choices import configure
from emgface.errors import ConfigurationError, DataError, FaceError, Refused, TreatmentError
from emgface.face.file import load_face, save_face
from emgface.face.motion import settle_face, simulate_face
from emgface.face.quality import element_quality
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.schema.validation import schema_folder
from emgface.treatment.motions import gestures
from emgface.treatment.plan import NOT_VALIDATED, Plan, plan_schema_text, read_plan
from emgface.treatment.sampled_volume import sampled_volume

FREE = {"contact": {"method": "none"}}
QUICK = configure(SimulationParameters, {"accuracy": "draft", **FREE, "sigma_max": 100e3})


def wedge(**given):
    step = {"kind": "wedge", "width": 12.0, "height": 11.0, "place": 0.44} | given
    return {"step": [step]}


@pytest.fixture(scope="module")
def operated(coarse):
    return ef.treat(coarse, wedge())


def report(face):
    return json.loads(face.attrs["treatment"])[-1]["steps"][-1]


def test_the_schema_of_a_plan_is_that_of_its_model():
    written = (schema_folder() / "treatment.json").read_text(encoding="utf-8")
    assert written == plan_schema_text(), "write emgface.treatment.plan.plan_schema_text() to it"


def test_every_length_of_a_plan_in_metres_is_refused_and_names_mm():
    from pydantic import BaseModel

    from emgface.treatment.plan import Change, Incision, Resection, Scar, Tumour, Wedge

    found = []
    for kind in (Wedge, Tumour, Incision, Change, Resection, Scar):
        assert issubclass(kind, BaseModel)
        for name, field in kind.model_fields.items():
            more = field.json_schema_extra
            if not isinstance(more, dict) or more.get("unit") != "mm":
                continue
            found.append(name)
            three = name in ("centre", "radii")
            value = [0.002, 0.098, 0.003] if three else 0.012
            given = {name: value}
            if kind is Tumour and name != "centre":
                given["centre"] = [0.0, 98.0, -10.0]
            if kind is Change:
                given["stiffness"] = 2.0
            aim = "98" if three else "12"
            with pytest.raises(ConfigurationError, match=f"{name} = .* in mm.* write .*{aim}"):
                configure(kind, given)
    assert {"width", "height", "retraction", "margin", "centre", "radii", "radius"} <= set(found)
    assert configure(Wedge, {"width": 0.0, "retraction": 0.0}).width == 0.0


@pytest.mark.parametrize(
    ("step", "message"),
    [
        ({"kind": "wedge", "widht": 12.0}, "step.0.wedge.widht', did you mean 'width'"),
        ({"kind": "palsy", "qqqq": 1}, "valid names are branch, degree, kind, muscles, side$"),
        ({"kind": "wedge", "scar": {"stifness": 2}}, "did you mean 'stiffness'"),
        (
            {"width": 12.0},
            "has no 'kind', expected one of change, incision, palsy, resection, tumour",
        ),
    ],
)
def test_a_wrong_name_in_a_step_of_a_plan_is_answered_with_the_valid_ones(step, message):
    with pytest.raises(ConfigurationError, match=message):
        configure(Plan, {"step": [step]})
    with pytest.raises(ConfigurationError) as many:
        configure(Plan, {"step": [{"kind": "palsy"}] * 51})
    assert len(str(many.value)) < 300


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


@pytest.mark.parametrize("size", [{"width": 0.0}, {"height": 0.0}])
def test_a_wedge_of_no_size_returns_the_face_itself(coarse, size):
    assert ef.treat(coarse, wedge(**size)) is coarse
    assert ef.treat(coarse, {}) is coarse


@pytest.mark.parametrize("shape", ["V", "W", "shield"])
def test_the_removed_volume_is_that_of_the_tissue_within_the_outline(coarse, shape):
    plan = wedge(shape=shape, scar=False)
    treated = ef.treat(coarse, plan)
    assert report(treated)["removed_volume_mm3"] == pytest.approx(
        1e9 * sampled_volume(coarse, plan["step"][0]), rel=0.02
    )


def test_the_closed_face_is_at_rest_and_differs_by_the_gap_alone(coarse, operated):
    scene = compose_scene(operated, configure(SimulationParameters, {"gravity": False, **FREE}))
    from sim import compile_scene

    system = compile_scene(scene)
    silent = system.control(np.zeros(len(system.muscles)))
    force = system.force(system.rest_state().q, silent).f.reshape(-1)
    assert np.abs(force[system.free]).max() < 1e-8
    assert report(operated)["closing_force_N"] > 0.05
    x = operated["position"].values
    away = KDTree(coarse["position"].values).query(x)[0]
    far = np.abs(x[:, 0]) > 0.05
    assert far.any() and away[far].max() < 0.1 * away.max()


@pytest.mark.parametrize("place", [0.5, 0.42])
def test_an_incision_without_removal_moves_like_the_intact_face(coarse, place):
    step = {"kind": "incision", "place": place, "scar": False, "rejoin": "all"}
    treated = ef.treat(coarse, {"step": [step]})
    moved = [
        simulate_face(f, gestures(f)["A"], QUICK, settled=settle_face(f, QUICK))["position"].values
        for f in (coarse, treated)
    ]
    assert np.linalg.norm(moved[0] - moved[0][..., :1], axis=1).max() > 1e-3
    assert np.linalg.norm(moved[0] - moved[1], axis=1).max() < 5e-5


def test_a_conforming_incision_cuts_the_fibres_that_it_crosses(coarse):
    """Between two lines of nodes, only a conforming cut divides elements; apart, OOM loses its ring."""
    step = {"kind": "incision", "place": 0.42, "rejoin": "none"}
    treated = ef.treat(coarse, {"step": [step]})
    found = report(treated)
    assert "OOM_L" in found["not_joined"] and "OOM_R" not in found["not_joined"]
    along = ef.treat(coarse, {"step": [{**step, "method": "elements"}]})
    assert report(along)["severed_muscles"] == []
    weights = treated["bundle_weight"].values
    assert 0 < (weights == 0.0).sum() < 0.2 * len(weights)


@pytest.mark.parametrize(
    "size",
    [
        {"shape": "rectangle", "width": 14.0, "height": 11.0, "place": 0.46},
        {"width": 26.4, "height": 14.0, "place": 0.5},
    ],
)
def test_elements_that_a_closure_would_fold_are_divided(coarse, size):
    """Half of the lower lip, and a rectangle whose corners are laid on a line."""
    treated = ef.treat(coarse, wedge(scar=False, **size))
    quality = element_quality(treated["position"].values, treated["connectivity"].values)
    assert quality.smallest_det.min() > 0.0
    assert report(treated)["smallest_J"] > 0.1


def test_the_closed_wound_has_closed_surfaces_for_contact(coarse, operated):
    """In the oblique wedge, a ring of facets around the mouth touches the suture in a single node."""
    oblique = ef.treat(coarse, wedge(place=0.42, width=12.0, height=11.0))
    for face in (operated, oblique):
        compose_scene(face, configure(SimulationParameters, {}))


def test_a_wound_of_the_outer_layer_is_refused_by_contact_with_its_remedy(coarse):
    treated = ef.treat(coarse, wedge(layers="outer", width=11.0))
    with pytest.raises(FaceError, match="contact off"):
        compose_scene(treated, configure(SimulationParameters, {}))
    compose_scene(treated, configure(SimulationParameters, FREE))


def test_an_incision_along_edges_leaves_the_motion_as_it_was(coarse):
    step = {"kind": "incision", "place": 0.42, "scar": False, "method": "elements"}
    treated = ef.treat(coarse, {"step": [step]})
    assert treated.sizes["element"] == coarse.sizes["element"]
    assert treated.sizes["suture"] >= 8
    p = QUICK.model_copy(update={"gravity": False})
    drive = gestures(coarse)["D"]
    moved = [simulate_face(f, drive, p)["position"].values for f in (coarse, treated)]
    assert np.linalg.norm(moved[0] - moved[1], axis=1).max() < 5e-5


def test_a_mirrored_plan_gives_the_mirrored_face(coarse):
    one, two = (ef.treat(coarse, wedge(place=p, shape="shield")) for p in (0.4, 0.6))
    mirrored = one["position"].values * [-1.0, 1.0, 1.0]
    assert KDTree(mirrored).query(two["position"].values)[0].max() < 1e-9


def test_palsy_weakens_the_active_stress_alone(coarse):
    palsy = {"kind": "palsy", "side": "left", "degree": 1.0}
    weak = ef.treat(coarse, {"step": [palsy]})
    from sim import compile_scene

    p = QUICK.model_copy(update={"gravity": False})
    before, after = (compile_scene(compose_scene(f, p)) for f in (coarse, weak))
    rng = np.random.default_rng(0)
    q = before.rest_state().q * (1.0 + 0.01 * rng.standard_normal((len(coarse["node"]), 1)) * 0.1)
    q = q * [1.2, 1.0, 1.0]  # fibres are stretched, so that their passive stress acts
    silent = before.control(np.zeros(20))
    np.testing.assert_allclose(
        after.force(q, silent).f, before.force(q, silent).f, rtol=1e-9, atol=1e-12
    )
    left = np.array([str(m).endswith("_L") for m in coarse["muscle"].values])
    pull = before.control(left.astype(float))
    np.testing.assert_allclose(
        after.force(q, pull).f, after.force(q, silent).f, rtol=1e-5, atol=1e-7
    )
    assert np.abs(before.force(q, pull).f - before.force(q, silent).f).max() > 1e-3


def test_a_change_of_stiffness_multiplies_the_passive_forces(coarse):
    stiff = ef.treat(coarse, {"step": [{"kind": "change", "stiffness": 2.5}]})
    from sim import compile_scene

    p = QUICK.model_copy(update={"gravity": False, "P1": 1e-9})
    systems = [compile_scene(compose_scene(f, p)) for f in (coarse, stiff)]
    silent = systems[0].control(np.zeros(20))
    q = systems[0].rest_state().q * [1.1, 1.0, 0.95]
    force = [s.force(q, silent).f for s in systems]
    np.testing.assert_allclose(force[1], 2.5 * force[0], rtol=1e-6, atol=1e-8)


def test_steps_combine_in_their_order_and_a_file_holds_them(coarse, tmp_path):
    text = """
    name = "both lips"
    [[step]]
    kind = "wedge"
    width = 9.0
    height = 9.0
    [[step]]
    kind = "wedge"
    lip = "upper"
    place = 0.3
    width = 8.0
    height = 8.0
    [[step]]
    kind = "palsy"
    branch = "mandibular"
    degree = 0.5
    """
    (tmp_path / "plan.toml").write_text(text, encoding="utf-8")
    treated = ef.treat(coarse, tmp_path / "plan.toml")
    again = load_face(save_face(treated, tmp_path / "treated.nc"))
    entry = json.loads(again.attrs["treatment"])[-1]
    assert [s["kind"] for s in entry["steps"]] == ["wedge", "wedge", "palsy"]
    assert entry["note"] == NOT_VALIDATED
    assert "simulated" in again.attrs["name"]
    np.testing.assert_array_equal(again["stress_free_position"], treated["stress_free_position"])
    assert again["muscle_strength"].sel(muscle="DAO_L") == 0.5


def test_a_second_excision_keeps_the_residual_stress_of_the_first(coarse):
    """Two wedges far from each other: the suture of the first has the same pull after the second."""
    first = wedge(place=0.32, width=8.0, height=8.0)["step"]
    second = wedge(place=0.5, lip="upper", width=8.0, height=8.0)["step"]
    one, both = ef.treat(coarse, {"step": first}), ef.treat(coarse, {"step": [*first, *second]})
    volumes = [_stress_free_volume(face) for face in (coarse, one, both)]
    removed = [
        1e-9 * r["removed_volume_mm3"] for r in json.loads(both.attrs["treatment"])[-1]["steps"]
    ]
    assert volumes[0] - volumes[1] == pytest.approx(removed[0], rel=0.05)
    assert volumes[1] - volumes[2] == pytest.approx(removed[1], rel=0.05)


@pytest.mark.parametrize("shape", ["V", "W", "shield", "rectangle"])
def test_nodes_moved_onto_a_cut_lose_no_tissue(coarse, shape):
    """The mass that is lost is that of the removed volume, though nodes move on curved surfaces."""
    step = wedge(shape=shape, width=14.0, place=0.46, scar=False)
    treated = ef.treat(coarse, step)
    removed = 1e-9 * report(treated)["removed_volume_mm3"]
    lost = _stress_free_volume(coarse) - _stress_free_volume(treated)
    assert lost == pytest.approx(removed, rel=0.01)
    assert removed == pytest.approx(sampled_volume(coarse, step["step"][0]), rel=0.01)


def test_the_volume_beneath_a_curved_surface_is_restored():
    """A vertex on a cylinder moves along a chord, which flattens it; its stack becomes thicker."""
    from emgface.treatment.plane import CutSurface, _restore_volume

    angle, height = np.linspace(-0.6, 0.6, 5), np.linspace(0.0, 1.0, 3)
    flat, stack = [], []
    for z in height:
        for a in angle:
            ring = np.array([-np.sin(a), np.cos(a), 0.0])
            flat.append(np.array([np.sin(a), z]))
            stack.append(np.array([1.2, 1.1, 1.0])[:, None] * ring + [0.0, 0.0, z])
    cells = [
        [5 * j + i, 5 * j + i + 1, 5 * j + i + 6, 5 * j + i + 5] for j in (0, 1) for i in range(4)
    ]
    surface = CutSurface(flat, stack, cells, list(range(8)))
    whole = surface.volume()
    surface.move(7, {7: 0.6, 8: 0.4})
    assert surface.volume() < (1.0 - 1e-4) * whole
    inner = surface.stack[7][-1].copy()
    _restore_volume(surface, [7], whole)
    assert surface.volume() == pytest.approx(whole, rel=1e-9)
    np.testing.assert_array_equal(surface.stack[7][-1], inner)


def _stress_free_volume(face):
    scene = compose_scene(face, QUICK)
    return float(scene.terms[0].node_mass(scene.mesh).sum()) / QUICK.density


@pytest.mark.parametrize(
    ("step", "reason"),
    [
        (wedge(place=0.05)["step"][0], "at the commissure: corner of the mouth"),
        (wedge(width=42.0, place=0.5)["step"][0], "too wide: cannot be sutured"),
        ({"kind": "tumour", "centre": [0.0, 60.0, 40.0]}, "tumour: not in the lower lip"),
        (
            wedge(width=0.6, height=1.0, method="elements")["step"][0],
            "too small: contains no element",
        ),
        ({"kind": "tumour", "surface": "../t.stl"}, "surface: in the folder of the plan"),
        (
            {"kind": "change", "stiffness": 2.0, "centre": [0, 0, 900], "radius": 1.0},
            "too small: no element",
        ),
        ({"kind": "resection"}, "other model: applies to a jaw model"),
    ],
)
def test_an_impossible_step_is_refused_with_its_reason(coarse, step, reason):
    code, words = reason.split(": ")
    with pytest.raises(TreatmentError, match=words) as caught:
        ef.treat(coarse, {"name": "impossible", "step": [step]})
    assert "step 1" in str(caught.value) and caught.value.reason == code
    sent = pickle.loads(pickle.dumps(caught.value))
    assert (sent.reason, str(sent)) == (code, str(caught.value))


def test_a_strength_out_of_range_is_refused_where_steps_multiply(coarse):
    strong = {"kind": "change", "strength": 4.0}
    with pytest.raises(TreatmentError, match="step 2 .*expected at most 10") as caught:
        ef.treat(coarse, {"step": [strong, strong]})
    assert caught.value.reason == "strength"


def test_every_refusal_of_a_step_has_a_reason_that_programs_can_read():
    """All errors that the modules of a step raise, and all reasons, in their source."""
    folder = Path(ef.__file__).parent / "treatment"
    raised: dict[str, set[str]] = {}
    for path in folder.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                if node.func.id == "TreatmentError":
                    first = node.args[0]
                    code = first.value if isinstance(first, ast.Constant) else "given"
                    raised.setdefault(path.stem, set()).add(code)
    assert set().union(*raised.values()) - {"given"} == set(get_args(Refused))
    for name in raised.keys() - {"treat"}:
        text = (folder / f"{name}.py").read_text(encoding="utf-8")
        assert " FaceError(" not in text, f"{name}.py raises an error without a reason"


@pytest.mark.parametrize(
    ("step", "reason"),
    [
        ({"kind": "wedge", "width": -1.0}, "greater than or equal to 0"),
        ({"kind": "wedge", "widht": 1.0}, "widht"),
        ({"kind": "wedge", "rejoin": ["OOX"]}, "OOX is unknown"),
        ({"kind": "palsy", "muscles": ["ZYG_R"], "side": "left"}, "none of the muscles"),
        ({"kind": "tumour"}, "either centre"),
        ({"kind": "change"}, "expected a factor"),
        ({"kind": "wedge", "height": float("nan")}, "finite"),
    ],
)
def test_a_plan_with_a_wrong_value_is_refused(step, reason):
    with pytest.raises(ConfigurationError, match=reason):
        configure(Plan, {"step": [step]}, where="plan")


def test_a_file_that_is_no_plan_is_refused(tmp_path):
    (tmp_path / "plan.toml").write_bytes(b"\xff\xfe[[")
    with pytest.raises(ConfigurationError, match="is not valid TOML|Cannot read"):
        read_plan(tmp_path / "plan.toml")
    with pytest.raises(ConfigurationError, match="is not valid TOML|Cannot read"):
        read_plan(tmp_path / "absent.toml")


def test_parameters_that_a_treated_face_does_not_support_are_refused(operated):
    for given in ({"muscle_form": "lines"}, {"prestress": {"method": "stretch"}},
                  {"incompressibility": "hard"}):  # fmt: skip
        p = configure(SimulationParameters, given)
        with pytest.raises(FaceError, match="not implemented for a treated face"):
            compose_scene(operated, p)


def test_the_reference_face_is_operated(shared):
    from emgface.face.artisynth import import_artisynth

    face = import_artisynth(shared / "artisynth_models")
    treated = ef.treat(face, wedge(width=8.0, height=8.0, place=0.4))
    assert report(treated)["smallest_J"] > 0.3
    assert "lip_triangle" not in treated
    compose_scene(treated, configure(SimulationParameters, {}))  # with contact


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
    found = []
    for side, stiffness in (("left", 0.0), ("left", 800.0), ("right", 800.0)):
        one, _ = resect(jaw, Resection(side=side, scar_stiffness=stiffness))
        found.append(deviation_at(opened_by_muscles(one), 5.0))
    assert found[1] < found[0] < 0.0  # towards the resected side, -x
    assert found[2] == pytest.approx(-found[1], abs=0.02)
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
    from emgface.treatment.resection import CUT, resect

    jaw = template_jaw()
    treated, told = resect(jaw, Resection(side="left"))
    plate, _ = resect(jaw, Resection(side="left", reconstruction="plate"))
    body = {"body": "jaw"}
    assert float(treated["body_mass"].sel(body)) == float(jaw["body_mass"].sel(body))
    way = (treated["body_centre"] - jaw["body_centre"]).sel(body).values
    assert way[0] > 10e-3 and told["moved_centre_of_mass_mm"] == pytest.approx(
        1e3 * np.linalg.norm(way)
    )
    assert (np.linalg.eigvalsh(treated["body_inertia"].sel(body).values) > 0.0).all()
    np.testing.assert_array_equal(plate["body_centre"], jaw["body_centre"])
    number = list(map(str, treated["body"].values)).index("jaw")
    bone = treated["surface_position"].values[treated["surface_body"].values == number]
    limit = CUT * float(jaw["point_position"].sel(point="bite_L", axis="x"))
    assert bone[:, 0].min() == pytest.approx(limit)  # the bone ends at the cut


def test_the_other_cut_of_a_treated_face_is_that_of_its_plan(coarse, operated):
    import pandas as pd

    from emgface.treatment.cut_difference import other_cut, with_cut_difference, with_other_cut

    other = other_cut(coarse, operated)
    direct = ef.treat(coarse, wedge(method="elements"))
    np.testing.assert_array_equal(other["position"].values, direct["position"].values)
    with pytest.raises(DataError, match="is not a treatment of"):
        other_cut(operated, direct)
    weak = configure(Plan, {"step": [{"kind": "palsy"}]})
    with pytest.raises(FaceError, match="cuts nothing"):
        with_other_cut(weak)
    one = pd.DataFrame({"outcome": ["a", "b"], "change": [-1.0, np.nan], "bound": ""})
    two = pd.DataFrame({"outcome": ["a", "b"], "change": [-3.0, 2.0], "bound": ""})
    both = with_cut_difference(one, two)
    assert list(both["change, lowest of both cuts"])[0] == -3.0
    assert list(both["change, highest of both cuts"])[0] == -1.0
    assert both["change, lowest of both cuts"].isna()[1]  # unknown if one method is


def test_a_treatment_is_known_by_the_digests_of_the_models_before_it(coarse, operated, tmp_path):
    from emgface.face.identity import treatments, treatments_between
    from emgface.face.template import template_face

    weak = {"name": "weak", "step": [{"kind": "palsy", "degree": 0.5}]}
    twice = load_face(save_face(ef.treat(operated, weak), tmp_path / "twice.nc"))
    first = load_face(save_face(coarse, tmp_path / "first.nc"))
    names = [e["plan"]["name"] for e in treatments_between(first, twice)]
    assert names == ["plan", "weak"]
    assert [e["plan"]["name"] for e in treatments_between(operated, twice)] == ["weak"]
    assert treatments_between(twice, twice) == []
    # the same plans of another person, and in another order, lead from neither to the other
    other = template_face(resolution="coarse", measures={"mouth_width": 0.05})
    turned = ef.treat(ef.treat(coarse, weak), wedge())
    assert len(treatments(turned)) == 2
    for before, after in (
        (other, twice), (coarse, ef.treat(other, weak)), (ef.treat(coarse, weak), twice),
        (operated, turned), (coarse, other),
    ):  # fmt: skip
        with pytest.raises(DataError, match="is not a treatment of"):
            treatments_between(before, after)
    with pytest.raises(DataError, match="exchange both"):
        treatments_between(twice, operated)
    for text in ("{", "{}", "[1]", '[{"plan": 3, "steps": []}]', '[{"plan": {}, "steps": [{}]}]'):
        with pytest.raises(DataError, match="is not a list of plans"):
            treatments(operated.assign_attrs(treatment=text))


def test_every_comparison_refuses_what_is_no_treatment(coarse, operated):
    """Motions, page, compensation, the other cut and the outcomes of jaws ask one place."""
    from emgface.anatomy.jaw.template import template_jaw
    from emgface.treatment.compensation import compensated
    from emgface.treatment.cut_difference import other_cut
    from emgface.treatment.jaw_outcomes import jaw_outcome_table
    from emgface.treatment.motions import compared_motions
    from emgface.treatment.plan import Resection
    from emgface.treatment.treat import treat_jaw

    jaw = template_jaw()
    resected = treat_jaw(jaw, Plan(step=(Resection(side="left"),)))
    for refused in (
        lambda: compared_motions(operated, coarse, gestures(coarse, ("A",)), QUICK, source=""),
        lambda: compensated(operated, coarse, {}, QUICK),
        lambda: other_cut(operated, coarse),
        lambda: jaw_outcome_table(resected, jaw),
    ):
        with pytest.raises(DataError, match="exchange both"):
            refused()


def test_a_resection_is_refused_for_a_face(coarse):
    with pytest.raises(FaceError, match="applies to a jaw model"):
        ef.treat(coarse, {"step": [{"kind": "resection"}]})


def test_found_activations_come_closer_to_the_intact_motion(coarse, operated):
    from emgface.treatment.compensation import compensated

    found = compensated(coarse, operated, {"OOP_L": 0.3, "OOP_R": 0.3}, QUICK)
    assert (found["activation"] >= 0.0).all() and (found["activation"] <= 1.0).all()
    assert (found["residual"] < found["uncompensated"]).all()
    assert float(found["residual"][-1]) < float(found["motion"][-1])
