"""Motion of a small tongue: closed forms of its lines, stiffening, activation, and refusals."""

import numpy as np
import pytest
from typer.testing import CliRunner

import sim
from emgface.anatomy.jaw.series import ramps
from emgface.anatomy.tongue.actions import action, raised_muscles
from emgface.anatomy.tongue.parameters import variant
from emgface.anatomy.tongue.run import simulate_tongue
from emgface.anatomy.tongue.scene import segment_forces, tongue_activation, tongue_scene
from emgface.cli import app
from emgface.errors import JawError, TongueError
from emgface.face.parts import Bundle, Fibre
from emgface.schema.netcdf import read_netcdf, write_netcdf
from tests.tongue.small import SIZE, small_tongue


def system_of(name="lines", tongue=None, **changes):
    given = variant(name, gravity=False, **changes)
    return sim.compile_scene(tongue_scene(tongue or small_tongue(), given))


def test_forces_of_segments_follow_the_volume_around_them():
    """Three equal cubes: every segment of GGP_L has one element, that outside the mesh the last one."""
    force = segment_forces(small_tongue())
    np.testing.assert_allclose(force, [3.0, 3.0, 3.0, 0.0, 2.0, 2.0, 0.0], rtol=1e-12)


@pytest.mark.parametrize("name", ["lines", "elements"])
def test_a_muscle_that_leaves_the_mesh_pulls_at_its_end_towards_the_bone(name):
    tongue = small_tongue()
    system = system_of(name, tongue, sigma_max=1e-9, stiffening=1.0)
    values = tongue_activation(tongue, system, np.array([[0.0, 0.5]]))[0]
    f = system.force(system.mesh.X, system.control(values)).f
    end = int(tongue["fibre_node"][5])
    along = np.array([0.0, SIZE, SIZE]) / np.hypot(SIZE, SIZE)
    pull = 0.5 * (2.0 if name == "lines" else 0.5)
    np.testing.assert_allclose(f[end], pull * (along - [0.0, 1.0, 0.0]), atol=1e-9)


def test_stiffening_multiplies_all_passive_moduli_of_active_elements():
    """Bulk modulus included: the energy of a passive deformation at full activation is tenfold."""
    tongue = small_tongue()
    system = system_of("elements", tongue, sigma_max=1e-9, outside_force=0.0)
    q = system.mesh.X * [1.02, 1.05, 0.97]
    q[system.mesh.X[:, 1] < 1e-9] = system.mesh.X[system.mesh.X[:, 1] < 1e-9]
    energy = [system.force(q, system.control(np.array([a, 0.0]))).energy for a in (0.0, 0.5, 1.0)]
    np.testing.assert_allclose(np.array(energy) / energy[0], [1.0, 5.5, 10.0], rtol=1e-6)
    step, f = 1e-7, system.force(q, system.control(np.array([0.5, 0.0]))).f
    moved = q.copy()
    moved[-1, 2] += step
    after = system.force(moved, system.control(np.array([0.5, 0.0]))).energy
    assert (energy[1] - after) / step == pytest.approx(f[-1, 2], rel=1e-3)


def test_damping_is_that_of_the_tissue_alone():
    """The stiffness of a tight line is not damped: at high tension D does not change."""
    tongue = small_tongue()
    damped = system_of("lines", tongue, stiffening=1.0, alpha=0.0)
    X, rest = damped.mesh.X, damped.control(np.zeros(2))
    D = [damped.damping(X, control) for control in (rest, damped.control(np.ones(2)))]
    np.testing.assert_array_equal(*D)
    _, K = damped.tangent(X, damped.control(np.ones(2)))
    with_K = damped.damping(X, damped.control(np.ones(2)), K)
    np.testing.assert_allclose(with_K, D[0], atol=1e-12 * np.abs(D[0]).max())
    assert np.abs(0.03 * K - D[0]).max() > 1e-3 * np.abs(D[0]).max()


def test_a_motion_is_labelled_and_survives_its_file(tmp_path):
    tongue = small_tongue()
    motion = simulate_tongue(
        tongue,
        raised_muscles("bi_GGP", duration=0.2),
        duration=0.2,
        parameters=variant("elements"),
        output=0.05,
    )
    motion = read_netcdf(write_netcdf(motion, tmp_path / "m.nc", "tongue_motion"), "tongue_motion")
    np.testing.assert_allclose(
        motion["activation"].sel(muscle="GGP_L"), [0.0, 0.15, 0.3, 0.15, 0.0]
    )
    forces = action(motion)
    assert forces["tip_forward"] < -1.0  # it shortens towards the jaw
    assert 0.0 < forces["smallest_J"] < 1.0
    attached = motion["node_position"].isel(node=tongue["attachment_node"].values)
    assert float((attached - attached.isel(time=0)).max()) == 0.0


def test_lines_keep_the_volume_of_every_element():
    motion = simulate_tongue(
        small_tongue(),
        raised_muscles("bi_GGP", level=0.03, duration=0.1),
        duration=0.1,
        parameters=variant("lines", gravity=False),
    )
    assert action(motion)["volume_percent"] < 1e-4


def test_the_jaw_carries_its_nodes():
    tongue = small_tongue()
    X = tongue["position"].values[tongue["attachment_node"].values]

    def lowered(t):
        return X + [0.0, 0.0, -0.01 * min(t, 0.1) / 0.1]

    motion = simulate_tongue(
        tongue,
        ramps({"bi_GGP": [(0.0, 0.0)]}),
        duration=0.5,
        output=0.1,
        parameters=variant("elements", gravity=False, beta=0.003),
        paths={"jaw": lowered},
    )
    down = motion["position"].sel(axis="z").isel(time=-1) - motion["position"].sel(axis="z").isel(
        time=0
    )
    np.testing.assert_allclose(down, -0.01, atol=2e-4)
    with pytest.raises(TongueError, match="no node follows 'hyoid', expected one of jaw"):
        tongue_scene(tongue, variant("elements"), paths={"hyoid": lowered})


def test_what_cannot_be_simulated_is_refused():
    with pytest.raises(TongueError, match="no variant 'strong', expected one of elements, lines"):
        variant("strong")
    with pytest.raises(JawError, match="no exciter is called 'GGP'"):
        simulate_tongue(small_tongue(), raised_muscles("GGP"), duration=0.1)
    along = np.array([[0.5, 0.5, 0.5], [0.5, 2.5, 0.5]]) * SIZE
    forward = np.array([[0.0, 1.0, 0.0]])
    inside = small_tongue(
        fibres=[Fibre("GGP_L", along)],
        bundles=[Bundle("GGP_L", np.array([1]), forward)],
        force_max={"GGP_L": 1.0},
    )
    with pytest.raises(TongueError, match="no fibre of GGP_L passes along its elements"):
        tongue_scene(inside, variant("lines"))


def test_the_commands_write_motion_page_and_table(tmp_path):
    model, moved = tmp_path / "tongue.nc", tmp_path / "moved.nc"
    write_netcdf(small_tongue(1), model, "tongue_model")
    given = ["--muscle", "bi_GGP", "--level", "0.1", "--duration", "0.1", "--no-gravity"]
    for command in (
        ["simulate", model, *given, "--out", moved],
        ["show", moved],
        ["show", moved, "--out", tmp_path / "moved.png"],
    ):
        result = CliRunner().invoke(app, ["tongue", *map(str, command)])
        assert result.exit_code == 0, result.output
    motion = read_netcdf(moved, "tongue_motion")
    assert motion.attrs["task"] == "bi_GGP"
    assert float(motion["activation"].sel(muscle="GGP_L").max()) == pytest.approx(0.1)
    page = (tmp_path / "moved.html").read_text(encoding="utf-8")
    assert "bi_GGP of the row of cubes" in page
    assert '"what":"tongue"' in page.replace(" ", "")
    assert (tmp_path / "moved.png").stat().st_size > 10_000
    result = CliRunner().invoke(app, ["show", str(model), "--out", str(tmp_path / "model.html")])
    assert result.exit_code == 0, result.output
