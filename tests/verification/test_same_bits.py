"""Bitwise equality of results, after a restart from a file and after other uses of a solver."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import sim
from sim.linear import LINEAR_SOLVERS, pardiso_is_available
from tests.bodies import crossed_muscles, grid, solid_system

H = 0.01
CONVERGED = sim.ConvergedEuler(tolerance=1e-5, residual_tolerance=2e-4)
HARD = "hard volumes"

SOLVERS = [
    pytest.param(
        name,
        marks=pytest.mark.skipif(
            "pardiso" in name and not pardiso_is_available(), reason="pypardiso is not installed"
        ),
    )
    for name in LINEAR_SOLVERS
    if name not in ("pardiso_ldlt", "superlu_pivoting")
]
INTEGRATORS = [
    sim.LinearlyImplicitEuler(),
    sim.LinearlyImplicitTrapezoidal(),
    CONVERGED,
    sim.Trapezoidal(tolerance=1e-5, residual_tolerance=2e-4),
    sim.Sdirk2(tolerance=1e-5, residual_tolerance=2e-4),
    sim.Static(tolerance=1e-5, residual_tolerance=1e-3),
    sim.RungeKutta4(),
]
CONTROLS = [
    sim.FixedStep(H),
    sim.HalvingStep(H),
    sim.ErrorControlledStep(tolerance=2e-5, h=H),
]


def block(volume: str = "") -> sim.System:
    """A block with two muscles, fixed at one end."""
    mesh = grid((3, 3, 2), distort=0.1, seed=2)
    terms = {"nodal": (sim.NodalVolume(),), HARD: ()}.get(volume, ())
    return solid_system(
        mesh,
        muscles=crossed_muscles(mesh),
        reductions=(sim.Fixed(np.flatnonzero(mesh.X[:, 0] == 0.0)),),
        constraints=(sim.HardElementVolume(),) if volume == HARD else (),
        damping=sim.RestRayleigh(),
        terms=(*terms, sim.Gravity()),
        relaxation=sim.Prony((0.2,), (0.05,)) if volume == "memory" else None,
    )


def falling(friction: float = 0.0, relaxation: sim.Prony | None = None) -> sim.System:
    """A block that falls onto a fixed one and is compressed by its weight."""
    low = grid((3, 3, 1), (0.02, 0.02, 0.006))
    high = grid((2, 2, 1), (0.012, 0.012, 0.006))
    n = len(low.X)
    X = np.concatenate([low.X, high.X + [0.0035, 0.0045, 0.0062]])
    hexes = np.concatenate([low.blocks[0].nodes, high.blocks[0].nodes + n])
    mesh = sim.mesh_from_arrays(X, hex8=hexes)
    skin = sim.boundary_surface(mesh).triangles
    below = sim.NodeSurface(skin[(skin < n).all(axis=1)], "below")
    above = sim.NodeSurface(skin[(skin >= n).all(axis=1)], "above")
    contact = sim.ConstraintContact((sim.Pairing(below, above),), friction=friction)
    terms = contact, sim.Gravity((2.0, 1.0, -40.0))
    fixed = sim.Fixed(np.flatnonzero(X[:, 2] == 0.0))
    return solid_system(
        mesh, reductions=(fixed,), damping=sim.RestRayleigh(), terms=terms, relaxation=relaxation
    )


def drive(system: sim.System, until: float) -> sim.Activation:
    """A burst that ends in the second half."""
    n = len(system.muscles)
    a = np.linspace(0.1, 0.3, n) if n else np.zeros(0)
    return sim.Activation(np.array([0.0, 0.4, 0.7]) * until, np.stack([0.0 * a, a, 0.2 * a]))


def require_a_restart_to_change_nothing(
    made, path: Path, *, integrator, steps=None, linear="auto", n=12, every=None
) -> None:
    """A run with a checkpoint compared with two halves, the second from a file with another system."""
    steps = steps or sim.FixedStep(H)
    until, kept = n * steps.h, list[sim.State]()

    def run(duration, initial=None, work=None):
        system = made()
        return sim.simulate(
            system,
            drive(system, until),
            duration=duration,
            integrator=integrator,
            steps=steps,
            every=every,
            checkpoint=round(0.5 * until / (every or steps.h)),
            at_checkpoint=kept.append,
            probes=(sim.Positions(), sim.Energies()),
            initial=initial,
            work=work or sim.Workspace(system, linear),
        )

    whole, end = run(until)
    (passed,) = kept
    _, middle = run(0.5 * until)
    assert passed.t == middle.t and set(passed.memory) == set(middle.memory)
    for name in ("q", "v", "frames", "twists"):
        np.testing.assert_array_equal(getattr(passed, name), getattr(middle, name))
    sim.save_state(middle, path)
    second, again = run(0.5 * until, sim.read_state(path))
    assert not np.array_equal(end.q, middle.q)  # it still moves
    assert again.t == end.t
    np.testing.assert_array_equal(again.q, end.q)
    np.testing.assert_array_equal(again.v, end.v)
    assert set(again.memory) == set(end.memory)
    for name, array in end.memory.items():
        np.testing.assert_array_equal(again.memory[name], array, err_msg=name)
    late = whole.isel(time=slice(-second.sizes["time"], None))
    for name in second.variables:
        np.testing.assert_array_equal(second[name].values, late[name].values, err_msg=str(name))


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda i: type(i).__name__)
def test_a_restart_changes_no_bit_with_any_integrator(integrator, tmp_path):
    steps = sim.FixedStep(1e-5 if isinstance(integrator, sim.RungeKutta4) else H)
    require_a_restart_to_change_nothing(
        block, tmp_path / "state.nc", integrator=integrator, steps=steps
    )


@pytest.mark.parametrize("linear", SOLVERS)
@pytest.mark.parametrize("integrator", [sim.LinearlyImplicitEuler(), CONVERGED], ids=["one", "all"])
def test_a_restart_changes_no_bit_with_any_solver(linear, integrator, tmp_path):
    for volume in ("", "nodal"):
        require_a_restart_to_change_nothing(
            lambda volume=volume: block(volume),
            tmp_path / "state.nc",
            integrator=integrator,
            linear=linear,
        )


@pytest.mark.parametrize("steps", CONTROLS, ids=lambda s: type(s).__name__)
def test_a_restart_changes_no_bit_with_any_step_control(steps, tmp_path):
    for integrator, every in ((CONVERGED, None), (sim.LinearlyImplicitEuler(), 0.5 * H)):
        require_a_restart_to_change_nothing(
            block, tmp_path / "state.nc", integrator=integrator, steps=steps, every=every
        )


@pytest.mark.parametrize("volume", [HARD, "memory"])
def test_a_restart_changes_no_bit_with_conditions_or_memory(volume, tmp_path):
    for integrator in (CONVERGED, sim.LinearlyImplicitEuler()):
        for linear in ("auto", "gmres_superlu"):
            require_a_restart_to_change_nothing(
                lambda: block(volume),
                tmp_path / "state.nc",
                integrator=integrator,
                linear=linear,
            )


@pytest.mark.parametrize(
    "friction, integrator",
    [
        (0.0, CONVERGED),
        (0.3, CONVERGED),
        (0.0, sim.LinearlyImplicitEuler()),
        (0.3, sim.Sdirk2()),
    ],
)
def test_a_restart_changes_no_bit_with_contact(friction, integrator, tmp_path):
    for linear in ("auto", "gmres_superlu"):
        require_a_restart_to_change_nothing(
            lambda: falling(friction),
            tmp_path / "state.nc",
            integrator=integrator,
            linear=linear,
            n=16,
        )


@pytest.mark.slow
def test_every_state_of_a_long_motion_continues_it_bit_for_bit(tmp_path):
    """500 steps with contact, friction and relaxation, continued from each of 11 states in files."""

    def run(duration, initial=None, at_checkpoint=None):
        system = falling(0.3, sim.Prony((0.2,), (0.05,)))
        return sim.simulate(
            system,
            drive(system, 500 * H),
            duration=duration,
            integrator=sim.LinearlyImplicitEuler(),
            steps=sim.FixedStep(H),
            every=5 * H,
            checkpoint=9,
            at_checkpoint=at_checkpoint,
            probes=(sim.Positions(), sim.Contacts()),
            initial=initial,
        )

    def keep(state):
        sim.save_state(state, tmp_path / f"{len(kept)}.nc")
        kept.append(state)

    kept = list[sim.State]()
    whole, end = run(500 * H, at_checkpoint=keep)
    assert len(kept) == 11 and len(whole.time) == 101
    touching = whole["contact_force"].values.sum(axis=1) > 0.0
    assert touching.mean() > 0.5
    assert not np.array_equal(kept[-1].q, end.q)  # it still moves
    for k, state in enumerate(kept):
        assert state.memory, "contact and relaxation remember"
        # the first to the end, the others to the next one: by induction each to the end
        then = kept[k + 1] if 0 < k < len(kept) - 1 else end
        rest, last = run(then.t - state.t, sim.read_state(tmp_path / f"{k}.nc"))
        assert last.t == then.t and set(last.memory) == set(then.memory)
        for name in ("q", "v"):
            np.testing.assert_array_equal(getattr(last, name), getattr(then, name))
        for name, array in then.memory.items():
            np.testing.assert_array_equal(last.memory[name], array, err_msg=name)
        first = int(np.searchsorted(whole["time"].values, state.t - 1e-9))
        same = whole.isel(time=slice(first, first + rest.sizes["time"]))
        for name in rest.variables:
            np.testing.assert_array_equal(rest[name].values, same[name].values, err_msg=str(name))


@pytest.mark.parametrize("integrator", [sim.LinearlyImplicitEuler(), CONVERGED], ids=["one", "all"])
def test_earlier_use_of_a_workspace_has_no_influence(integrator):
    system = block("nodal")
    used = sim.Workspace(system, "gmres_superlu")

    def run(work, size):
        activation = sim.Activation(
            np.array([0.0, 0.05]), size * np.array([[0.0, 0.0], [0.3, 0.1]])
        )
        steps = sim.ErrorControlledStep(tolerance=2e-5, h=H)
        options = {"duration": 0.05, "integrator": integrator, "steps": steps, "work": work}
        return sim.simulate(system, activation, **options)[1]

    first = run(sim.Workspace(system, "gmres_superlu"), 1.0)
    run(used, 0.5)
    np.testing.assert_array_equal(run(used, 1.0).q, first.q)


def test_checkpoints_change_a_motion_by_the_tolerance_and_keep_its_outputs():
    system, reported = block(), list[tuple[int, int]]()

    def run(checkpoint, progress=None):
        return sim.simulate(
            system,
            drive(system, 0.1),
            duration=0.1,
            integrator=CONVERGED,
            probes=(sim.Positions(),),
            checkpoint=checkpoint,
            progress=progress,
        )

    (whole, end), (other, again) = (
        run(None),
        run(4, lambda done, total: reported.append((done, total))),
    )
    np.testing.assert_allclose(other.time, whole.time, rtol=1e-12)
    np.testing.assert_allclose(again.q, end.q, rtol=0, atol=1e-5)
    assert not np.array_equal(again.q, end.q)  # solved with another factor
    assert [done for done, _ in reported] == list(range(1, 11)) and reported[-1][1] >= 10
    assert not any(name.startswith("solver") for name in end.memory)


def test_a_checkpoint_after_no_output_is_refused():
    system = block()
    with pytest.raises(
        sim.ControlError, match="checkpoint = 0, expected a whole number of at least 1"
    ):
        sim.simulate(system, drive(system, 0.05), duration=0.01, checkpoint=0)


def test_a_state_of_another_scene_is_refused():
    """The memory of its terms would be ignored or mistaken."""
    system, other = block(), block("nodal")
    _, state = sim.simulate(system, drive(system, 0.05), duration=0.02, integrator=CONVERGED)
    given = {"duration": 0.02, "integrator": CONVERGED}
    with pytest.raises(sim.SceneError, match="belongs to another scene"):
        sim.simulate(other, drive(other, 0.05), initial=state, **given)
    bare = sim.State(state.t, state.q, state.v)
    assert np.isfinite(sim.simulate(other, drive(other, 0.05), initial=bare, **given)[1].q).all()


def test_a_file_that_is_not_a_state_is_refused(tmp_path):
    with pytest.raises(sim.SceneError, match=r"none\.nc is not a file"):
        sim.read_state(tmp_path / "none.nc")
    path = tmp_path / "text.nc"
    path.write_text("no netCDF")
    with pytest.raises(sim.SceneError, match="contains no state"):
        sim.read_state(path)
    system = block()
    data, _ = sim.simulate(system, drive(system, 0.05), duration=0.01)
    data.to_netcdf(tmp_path / "motion.nc")
    with pytest.raises(sim.SceneError, match="contains no state"):
        sim.read_state(tmp_path / "motion.nc")


@pytest.mark.slow
def test_processes_that_compile_or_load_with_other_threads_and_hash_seeds_give_the_same_bits(root):
    """The first compiles into an empty cache, the others load; with one, two and four threads."""
    command = [sys.executable, "-m", "benchmarks", "same_bits", "--processes", "3"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=1800, cwd=root)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("1 digest(s) in 3 processes") == 6
