"""The generated jaw: the person of the face, exact symmetry, and movements within published norms."""

import numpy as np
import pytest
from typer.testing import CliRunner

from emgface.anatomy.jaw.outcomes import interincisal, outcome, point_displacement, separation
from emgface.anatomy.jaw.run import run_task, simulate_jaw
from emgface.anatomy.jaw.series import ramps
from emgface.anatomy.jaw.tasks import JAW_TASKS
from emgface.anatomy.jaw.template import JAW_NORMS, template_jaw
from emgface.cli import app
from emgface.errors import JawError
from emgface.face.template.arches import dental_arches
from emgface.face.template.volunteers import preset_measures
from emgface.schema.netcdf import read_netcdf

MIRROR = np.array([-1.0, 1.0, 1.0])


@pytest.fixture(scope="module")
def jaw():
    return template_jaw(preset="woman")


def test_jaw_belongs_to_the_face_of_the_same_person(jaw):
    """Incisors are those of the dental arches; the condyles lie 5 to 20 mm before the tragia and in the
    face, and the triangle of Bonwill has its published mean sides."""
    face = preset_measures("woman")
    lower = dental_arches(face)[1].points
    incisor = jaw["point_position"].sel(point="lower_incisor").values
    assert np.linalg.norm(lower - incisor, axis=1).min() < 1e-12
    assert lower[:, 2].max() == pytest.approx(incisor[2], abs=1e-12)
    condyles = [jaw["point_position"].sel(point=f"condyle_{s}").values for s in "LR"]
    assert all(5e-3 < c[1] < 20e-3 and abs(c[0]) < 0.45 * face.face_width for c in condyles)
    assert np.linalg.norm(condyles[0] - condyles[1]) == pytest.approx(97.0e-3, abs=1e-4)
    assert np.linalg.norm(condyles[0] - incisor) == pytest.approx(100.6e-3, abs=1e-4)
    big = template_jaw(preset="man")
    for name in ("muscle_position", "surface_position"):
        assert np.ptp(big[name].values, axis=0).max() > np.ptp(jaw[name].values, axis=0).max()


def test_sides_are_mirror_images(jaw):
    """Muscles, springs, joints and points of the left are those of the right, mirrored, within 1e-12."""
    for kind, what in (("muscle", "position"), ("spring", "position"), ("point", "position"),
                       ("joint", "origin"), ("joint", "normal")):  # fmt: skip
        names = [str(n) for n in jaw[kind].values]
        values = dict(zip(names, jaw[f"{kind}_{what}"].values, strict=True))
        pairs = [(n, n[:-2] + "_R") for n in names if n.endswith("_L")]
        assert pairs
        for left, right in pairs:
            np.testing.assert_allclose(values[left] * MIRROR, values[right], atol=1e-12)
    inertia = jaw["body_inertia"].values
    assert np.abs(inertia[:, 0, 1:]).max() == 0.0
    assert np.abs(jaw["body_centre"].values[:, 0]).max() == 0.0
    X = jaw["surface_position"].values
    distance = [np.linalg.norm(X - x * MIRROR, axis=1).min() for x in X[:: len(X) // 40]]
    assert max(distance) < 1e-9


def test_closed_surfaces_have_the_masses(jaw):
    """The volume of each bone is that of its tube; bone is 1.0 to 2.5 times as dense as water."""
    volume = 200e-6  # of a mandible with teeth and tissue of 171 g it would be less than this
    row = jaw.sel(body="jaw")
    radius = np.sqrt(np.trace(row["body_inertia"].values) / 2.0 / float(row["body_mass"]))
    assert 0.02 < radius < 0.06
    assert 0.1 < float(row["body_mass"]) < volume * 2500.0


def test_symmetric_drive_moves_symmetrically(jaw):
    motion = simulate_jaw(
        jaw, ramps({"bi_ad": [(0.0, 0.0), (0.1, 0.6)], "bi_ip": [(0.0, 0.4)]}), duration=0.25
    )
    for name in ("lower_incisor", "hyoid", "thyroid"):
        assert np.abs(point_displacement(motion, name)[:, 0]).max() < 1e-9
    left, right = (point_displacement(motion, f"condyle_{s}") for s in "LR")
    assert np.abs(left * MIRROR - right).max() < 1e-9
    assert right[-1, 1] > 3.0


@pytest.mark.parametrize("preset", ["woman", "man"])
def test_border_movements_are_within_norms(preset):
    """Gape 40 to 55 mm, protrusion 5 to 10 mm, laterotrusion 7 to 12 mm.

    Means of 316 students 51.2, 8.0 and 9.3 mm (Woelfel et al. 2014, J Adv Prosthodont 6:483-490), of 140
    students 48.8 mm of gape (Zawawi et al. 2003, J Can Dent Assoc 69:737-741), of 500 patients 49.3,
    8.8 and 9.4 to 11.8 mm (Swiss Dent J, maximum mandibular mobility).
    """
    jaw = template_jaw(preset=preset)
    assert 40.0 <= interincisal(run_task(jaw, JAW_TASKS["gape"])).max() <= 55.0
    assert 5.0 <= outcome(run_task(jaw, JAW_TASKS["protrude"]))["end_forward"] <= 10.0
    aside = outcome(run_task(jaw, JAW_TASKS["lateral"]))
    assert 7.0 <= aside["end_right"] <= 12.0
    assert aside["end_down"] < 6.0


def test_reactions_balance_muscles_and_weight_in_clenching(jaw):
    """Forces of teeth and condyles on the mandible, muscles, and weight add up to zero at rest."""
    motion = run_task(jaw, JAW_TASKS["clench"], duration=0.5)
    at = motion.isel(time=-1)
    own = [n for n in motion["joint"].values if n[:-2] in ("tmj", "posterior", "lateral", "bite")]
    reaction = at["joint_force"].sel(joint=own).sum("joint").values
    mandible = [str(b) for b in motion["body"].values].index("jaw")
    total = reaction + [0.0, 0.0, -9.8 * float(jaw["body_mass"].sel(body="jaw"))]
    frames, q = at["body_position"].values, at["body_quaternion"].values
    assert np.abs(q[mandible, 1:]).max() < 0.05
    for name in motion["muscle"].values:
        row = at.sel(muscle=name)
        ends, bodies = row["muscle_position"].values, row["muscle_body"].values
        if mandible in bodies:
            k = int(bodies[1] == mandible)
            moved = [_on(frames, q, motion, b, x) for b, x in zip(bodies, ends, strict=True)]
            way = moved[1 - k] - moved[k]
            total = total + float(row["muscle_force"]) * way / np.linalg.norm(way)
    assert np.linalg.norm(reaction) > 50.0
    assert np.linalg.norm(total) < 0.05
    bite = at["joint_force"].sel(joint=["bite_L", "bite_R"]).values
    assert (bite[:, 2] < 0.0).all()  # the teeth push the mandible down


def _on(frames, q, motion, body, x):
    if body < 0:
        return x
    start = motion["body_position"].values[body, :, 0]
    w, r = q[body, 0], q[body, 1:]
    y = x - start
    t = 2.0 * np.cross(r, y)
    return frames[body] + y + w * t + np.cross(r, t)


def test_steps_too_long_for_the_muscles_are_refused(jaw):
    """Maximum effort moves the incisor by 23 mm with steps of 1 and 10 ms, and by 42 mm with 25 ms."""
    with pytest.raises(
        JawError, match=r"steps of 25 ms are too long before 0\.\d+ s.* such as 6\.25 ms"
    ):
        run_task(jaw, JAW_TASKS["effort"], step=25e-3)
    motion = run_task(jaw, JAW_TASKS["effort"], step=1e-2)
    assert np.linalg.norm(point_displacement(motion, "lower_incisor"), axis=1).max() < 25.0


@pytest.mark.parametrize("law", ["hill", "pennate", "spring"])
def test_laws_are_exchangeable(jaw, law):
    motion = simulate_jaw(jaw, ramps({"bi_ad": [(0.0, 0.5)]}), duration=0.1, law=law, step=2.5e-3)
    assert motion.attrs["law"] == law
    assert point_displacement(motion, "lower_incisor")[-1, 2] < -1.0
    assert np.isfinite(motion["muscle_force"].values).all()


def test_commands_build_run_and_show(tmp_path):
    files = {
        n: str(tmp_path / n) for n in ("jaw.nc", "drive.csv", "open.nc", "open.html", "open.png")
    }
    (tmp_path / "drive.csv").write_text("time,bi_ad\n0,0\n0.05,0.5\n")
    for command in (
        ["build", "--out", files["jaw.nc"], "--preset", "woman", "--set", "condyle_width=95mm"],
        ["run", files["jaw.nc"], "--excitation", files["drive.csv"], "--out", files["open.nc"]],
        ["show", files["open.nc"]],
        ["show", files["open.nc"], "--out", files["open.png"]],
    ):
        result = CliRunner().invoke(app, ["jaw", *command])
        assert result.exit_code == 0, result.output
    assert read_netcdf(files["jaw.nc"], "jaw_model").attrs["measure_condyle_width"] == 0.095
    page = (tmp_path / "open.html").read_text(encoding="utf-8")
    assert "simulated motion" in page
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert (tmp_path / "open.png").stat().st_size > 10_000


def test_norms_are_complete_and_impossible_measures_refused():
    assert all(norm.source and norm.standing in ("found", "assumption") for norm in JAW_NORMS)
    with pytest.raises(JawError, match="condyle_width is 120 mm, expected at most"):
        template_jaw(measures={"condyle_width": 0.120})
    with pytest.raises(JawError, match="hyoid_drop is 90 mm, expected 2 to 40 mm"):
        template_jaw(measures={"hyoid_drop": 0.090})
    with pytest.raises(JawError, match="unknown measure 'wing_span'"):
        template_jaw(measures={"wing_span": 1.0})


@pytest.mark.parametrize("preset", ["woman", "man"])
def test_the_generated_jaw_chews(preset):
    """It opens, returns along the side of the morsel, which it crushes, and closes."""
    motion = run_task(template_jaw(preset=preset), JAW_TASKS["chew"], step=5e-3, check=False)
    d, apart = point_displacement(motion, "lower_incisor"), separation(motion)
    k, aside = int(np.argmin(d[:, 2])), int(np.argmax(np.abs(d[:, 0])))
    assert 12.0 < -d[k, 2] < 25.0
    assert -10.0 < d[aside, 0] < -3.0  # the morsel is on the left, at negative x
    assert aside > k
    assert float(motion["morsel_force"].max()) > 30.0
    assert apart[-1] < 1.0 and 10.0 < apart.max() < 20.0
