"""Plans of treatments: their schema, wrong values, and what is refused."""

import json
import pickle

import numpy as np
import pytest

import emgface as ef
from emgface.anatomy.jaw.template import template_jaw
from emgface.choices import configure
from emgface.errors import ConfigurationError, DataError, FaceError, JawError, TreatmentError
from emgface.face.file import load_face, save_face
from emgface.schema.validation import schema_folder
from emgface.treatment.motions import gestures
from emgface.treatment.plan import (
    NOT_VALIDATED,
    Plan,
    Scar,
    plan_schema_text,
    read_plan,
    steps_digest,
)
from emgface.treatment.treat import treat_face, treat_jaw
from tests.treatment.plans import QUICK, ball_in_lower_lip, wedge


def test_the_schema_of_a_plan_is_that_of_its_model():
    written = (schema_folder() / "treatment.json").read_text(encoding="utf-8")
    assert written == plan_schema_text(), "write emgface.treatment.plan.plan_schema_text() to it"


def test_every_length_of_a_plan_in_metres_is_refused_and_names_mm():
    from pydantic import BaseModel

    from emgface.treatment.plan import Change, Incision, Resection, Scar, Tumour, Wedge

    lengths = []
    for kind in (Wedge, Tumour, Incision, Change, Resection, Scar):
        assert issubclass(kind, BaseModel)
        for name, field in kind.model_fields.items():
            more = field.json_schema_extra
            if not isinstance(more, dict) or more.get("unit") != "mm":
                continue
            lengths.append(name)
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
    assert {"width", "height", "retraction", "margin", "centre", "radii", "radius"} <= set(lengths)
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


def test_a_plan_that_the_face_already_carries_is_refused_with_its_name_and_digest(coarse, operated):
    """Whatever the plan is called, and also where its steps could be applied again."""
    weak = ef.treat(coarse, {"name": "weak", "step": [{"kind": "palsy", "degree": 0.5}]})
    jaw = template_jaw()
    resection = {"step": [{"kind": "resection", "side": "left"}]}
    for face, given, error in (
        (operated, wedge(), TreatmentError),
        (weak, {"name": "other", "step": [{"kind": "palsy", "degree": 0.5}]}, TreatmentError),
        (ef.treat(weak, {"step": [{"kind": "palsy", "degree": 0.1}]}),
         {"step": [{"kind": "palsy", "degree": 0.5}]}, TreatmentError),
        (treat_jaw(jaw, configure(Plan, resection)), resection, JawError),
    ):  # fmt: skip
        treat = treat_jaw if error is JawError else treat_face
        with pytest.raises(error) as caught:
            treat(face, configure(Plan, given))
        text = str(caught.value)
        entry = json.loads(face.attrs["treatment"])[0]
        assert f"already carries the plan {entry['plan']['name']!r}, applied to" in text
        assert entry["applied_to"][:8] in text and steps_digest([given]) in text
        assert "treat the model before it" in text and "act twice" in text
        assert getattr(caught.value, "reason", "repeated") == "repeated"
    again = ef.treat(weak, {"step": [{"kind": "palsy", "degree": 0.25}]})  # another plan
    assert float(again["muscle_strength"].min()) == 0.375


def test_an_excision_of_an_earlier_suture_is_refused_with_its_cause(coarse, operated):
    digest = json.loads(operated.attrs["treatment"])[0]["applied_to"][:8]
    text = (
        f"suture of step 1 .wedge. of the plan 'plan', applied to .*{digest}: excise both at once"
    )
    with pytest.raises(TreatmentError, match=text):
        ef.treat(operated, wedge(width=13.0))
    own = [{"kind": "palsy", "degree": 0.1}, *wedge()["step"], *wedge(width=13.0)["step"]]
    with pytest.raises(TreatmentError, match="step 3 .*suture of step 2 .wedge. of this plan"):
        ef.treat(coarse, {"step": own})
    with pytest.raises(TreatmentError) as elsewhere:  # a wound of its own that cannot be closed
        ef.treat(operated, wedge(lip="upper", width=42.0, place=0.5))
    assert "suture of an earlier" not in str(elsewhere.value)


@pytest.mark.parametrize(("scale", "unit", "other"), [(3e-3, "mm", "m"), (3.0, "m", "mm")])
def test_a_surface_in_another_unit_is_refused_with_the_right_one(
    coarse, tmp_path, scale, unit, other
):
    pytest.importorskip("trimesh")
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    lines = [f"v {x} {y} {z}" for x, y, z in scale * corners]
    lines += ["f 1 3 2", "f 1 2 4", "f 2 3 4", "f 1 4 3"]
    (tmp_path / "tumour.obj").write_text("\n".join(lines), encoding="utf-8")
    step = {"kind": "tumour", "surface": "tumour.obj", "unit": unit}
    plan = configure(Plan, {"step": [step]})
    with pytest.raises(TreatmentError, match=f"write unit = '{other}'") as caught:
        treat_face(coarse, plan, folder=tmp_path)
    assert caught.value.reason == "surface"


def test_an_open_surface_is_refused_and_its_orientation_does_not_matter(coarse, tmp_path):
    """Of an open surface a part of the tumour is unknown, and the excision would be too small."""
    trimesh = pytest.importorskip("trimesh")
    ball = ball_in_lower_lip(coarse, depth=4.0)
    positions = []
    for name, faces in (
        ("closed", ball.faces), ("turned", ball.faces[:, ::-1]), ("open", ball.faces[:200])
    ):  # fmt: skip
        trimesh.Trimesh(ball.vertices, faces, process=False).export(tmp_path / f"{name}.stl")
        step = {"kind": "tumour", "surface": f"{name}.stl", "margin": 1.0}
        plan = configure(Plan, {"step": [step]})
        if name != "open":
            positions.append(treat_face(coarse, plan, folder=tmp_path)["position"].values)
            continue
        with pytest.raises(TreatmentError, match="edges that do not join two triangles") as caught:
            treat_face(coarse, plan, folder=tmp_path)
        assert caught.value.reason == "surface"
    np.testing.assert_array_equal(*positions)


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
        ({"kind": "wedge", "width": "1.2 cm"}, r"width = '1.2 cm': .* in mm, .* write width = 12$"),
        ({"kind": "wedge", "width": 1.2, "unit": "cm"}, "unit = 'cm': .* in mm, .* omit unit"),
        ({"kind": "wedge", "scar": {"radius": "3 mm"}}, r"scar: .* write radius = 3$"),
        ({"kind": "wedge", "scar": 0}, "scar = 0: expected a table .* or false"),
        ({"kind": "wedge", "place": 42}, r"in percent, write place = 0.42$"),
        ({"kind": "palsy", "degree": "60 %"}, r"in percent, write degree = 0.6$"),
        ({"kind": "palsy", "degree": 2.0}, "expected a share from 0 to 1"),
        ({"kind": "wedge", "rejoin": "some"}, "rejoin: muscle some is unknown"),
        ({"kind": "palsy", "muscles": "XYZ"}, "muscles: muscle XYZ is unknown"),
        ({"kind": "wedge", "lip": "both"}, "should be 'upper' or 'lower'"),
    ],
)
def test_a_plan_with_a_wrong_value_is_refused(step, reason):
    with pytest.raises(ConfigurationError, match=reason):
        configure(Plan, {"step": [step]}, where="plan")


def test_one_name_and_true_are_what_they_say():
    one, two = (
        configure(Plan, {"step": [{"kind": "palsy", "muscles": m}]}) for m in ("ZYG", ["ZYG"])
    )
    assert one == two
    cut = configure(Plan, {"step": [{"kind": "wedge", "rejoin": "OOP", "scar": True}]}).step[0]
    assert cut.rejoin == ("OOP_L", "OOP_R") and cut.scar == Scar()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[face]\npath = 'face.nc'\n[simulation]\nsigma_max = 1e5\n",
            "is no plan .* has face, simul",
        ),
        ("[step]\nkind = 'wedge'\n", r"is one table, expected .* write \[\[step\]\]"),
        ("[[step]]\nkind = 'Wedge'\n", "expected tags: 'wedge'"),
        ("[[step]]\nkind = 'palsy'\n" * 200, "at most 50 items"),
    ],
)
def test_a_file_of_another_kind_is_refused_with_what_is_expected(tmp_path, text, message):
    (tmp_path / "plan.toml").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match=message) as caught:
        read_plan(tmp_path / "plan.toml")
    assert "plan.toml" in str(caught.value) and len(str(caught.value)) < 400


def test_muscles_outside_the_region_of_a_change_are_refused(coarse):
    step = {"kind": "change", "lip": "upper", "muscles": ["MEN"], "stiffness": 2.0}
    with pytest.raises(TreatmentError, match="no part of MEN_L, MEN_R is in the region"):
        ef.treat(coarse, {"step": [step]})


def test_a_file_that_is_no_plan_is_refused(tmp_path):
    (tmp_path / "plan.toml").write_bytes(b"\xff\xfe[[")
    with pytest.raises(ConfigurationError, match="is not valid TOML|Cannot read"):
        read_plan(tmp_path / "plan.toml")
    with pytest.raises(ConfigurationError, match="is not valid TOML|Cannot read"):
        read_plan(tmp_path / "absent.toml")


def test_every_comparison_refuses_what_is_no_treatment(coarse, operated):
    """Motions, page, compensation, the other cut and the outcomes of jaws ask one place."""
    from emgface.treatment.compensation import compensated
    from emgface.treatment.cut_difference import other_cut
    from emgface.treatment.jaw_outcomes import jaw_outcome_table
    from emgface.treatment.motions import compared_motions
    from emgface.treatment.plan import Resection

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


@pytest.mark.parametrize("plan", [None, 3, [{"kind": "wedge", "width": 8.0, "lip": "upper"}], {3}])
def test_what_is_no_plan_is_refused_in_memory(coarse, plan):
    """A list of steps, or nothing, in the place of a plan: the sentence names what is expected."""
    with pytest.raises(ConfigurationError, match="expected a table of names and values"):
        ef.treat(coarse, plan)
