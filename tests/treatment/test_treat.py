"""Treated faces against closed forms, untreated faces and mirror images."""

import ast
import json
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from scipy.spatial import KDTree

import emgface as ef
from emgface.choices import configure
from emgface.errors import DataError, FaceError, Refused, TreatmentError
from emgface.face.file import load_face, save_face
from emgface.face.motion import settle_face, simulate_face
from emgface.face.quality import element_quality
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.treatment.motions import gestures
from emgface.treatment.plan import Plan
from emgface.treatment.sampled_volume import sampled_volume
from tests.treatment.plans import FREE, QUICK, ball_in_lower_lip, report, wedge


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
    page = report(treated)
    assert "OOM_L" in page["not_joined"] and "OOM_R" not in page["not_joined"]
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


def test_a_change_of_all_tissue_and_a_wedge_apply_in_any_order(coarse):
    """Both faces are at rest, so that their equilibrium is the same, as are all lengths at rest."""
    cut = wedge(scar=False)["step"][0]
    stiff = {"kind": "change", "stiffness": 3.0}
    one, two = (ef.treat(coarse, {"step": steps}) for steps in ([stiff, cut], [cut, stiff]))
    apart = np.linalg.norm(one["position"].values - two["position"].values, axis=1).max()
    moved = np.linalg.norm(
        two["position"].values - ef.treat(coarse, {"step": [cut]})["position"].values, axis=1
    ).max()
    assert apart < 1e-6 < 0.01 * moved
    np.testing.assert_allclose(one["bundle_direction"], two["bundle_direction"], atol=1e-3)


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


def test_a_strength_out_of_range_is_refused_where_steps_multiply(coarse):
    strong = {"kind": "change", "strength": 4.0}
    with pytest.raises(TreatmentError, match="step 2 .*expected at most 10") as caught:
        ef.treat(coarse, {"step": [strong, strong]})
    assert caught.value.reason == "strength"


def test_a_stiffness_out_of_range_is_refused_where_steps_and_scars_multiply(coarse):
    stiff = {"kind": "change", "stiffness": 100.0}
    for second in (stiff, wedge(scar={"stiffness": 20.0})["step"][0]):
        with pytest.raises(TreatmentError, match="step 2 .*expected 0.001 to 1000") as caught:
            ef.treat(coarse, {"step": [stiff, second]})
        assert caught.value.reason == "stiffness"
    soft = {"kind": "change", "stiffness": 0.01}
    with pytest.raises(TreatmentError, match="expected 0.001 to 1000"):
        ef.treat(coarse, {"step": [soft, soft]})


def test_the_surface_of_a_tumour_is_required_only_where_it_is_excised(coarse, tmp_path):
    """The page draws the wedge of the report, and the other cut repeats it, without the file."""
    pytest.importorskip("trimesh")
    from emgface.face.identity import treatments
    from emgface.pictures.body import body_of
    from emgface.treatment.cut_difference import other_cut
    from emgface.treatment.pages import _drawn_plan

    ball = ball_in_lower_lip(coarse, depth=3.0)
    ball.export(tmp_path / "tumour.stl")
    path = tmp_path / "plan.toml"
    path.write_text('[[step]]\nkind = "tumour"\nsurface = "tumour.stl"\nmargin = 2.0\n')
    treated = ef.treat(coarse, path)
    (tmp_path / "tumour.stl").unlink()
    page = report(treated)
    assert page["kind"] == "tumour" and page["width"] > 6.0 < page["height"]
    assert (_drawn_plan(coarse, treated).colour != body_of(coarse).colour).any()
    wedge_of_it = {name: page[name] for name in ("place", "width", "height")}
    direct = {"kind": "wedge", "shape": "shield", "method": "elements"} | wedge_of_it
    np.testing.assert_array_equal(
        other_cut(coarse, treated)["position"], ef.treat(coarse, {"step": [direct]})["position"]
    )
    assert treatments(treated)[0]["plan"]["step"][0]["surface"] == "tumour.stl"


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
    unapplied = '[{"plan": {}, "steps": []}]'
    for text in ("{", "{}", "[1]", unapplied, '[{"plan": {}, "steps": [{}]}]'):
        with pytest.raises(DataError, match="is not a list of plans"):
            treatments(operated.assign_attrs(treatment=text))


def test_found_activations_come_closer_to_the_intact_motion(coarse, operated):
    from emgface.treatment.compensation import compensated

    result = compensated(coarse, operated, {"OOP_L": 0.3, "OOP_R": 0.3}, QUICK)
    assert (result["activation"] >= 0.0).all() and (result["activation"] <= 1.0).all()
    assert (result["residual"] < result["uncompensated"]).all()
    assert float(result["residual"][-1]) < float(result["motion"][-1])
