"""Forces of muscles: closed forms, the energy of the scene, files, and faces without fibre lines."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import emgface as ef
import sim
from emgface.face.muscle_force import MUSCLE_FORCE, MuscleForces, fibre_lengths
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.pictures.surface import without_surface
from emgface.schema.netcdf import read_netcdf, write_netcdf
from sim.state import Control

FREE = {"method": "none"}
PARAMETERS = SimulationParameters(accuracy="draft", contact=FREE, sigma_max=80e3)


@pytest.mark.parametrize("law", ["blemker", "generic"])
def test_at_rest_the_force_is_stress_times_cross_section(coarse, law):
    """No fibre is stretched: F = sigma_max activation V / L; the generic law has no passive force."""
    parameters = PARAMETERS.model_copy(update={"fibre_law": law})
    forces = MuscleForces.from_face(coarse, parameters)
    volume = np.zeros(len(forces.muscles))
    sizes = sim.compile_scene(compose_scene(coarse, parameters)).mesh.volumes()
    muscles = compose_scene(coarse, parameters).terms[0].muscles
    np.add.at(volume, muscles.muscle, muscles.weight * sizes[muscles.element])
    level = np.linspace(0.0, 1.0, len(volume))
    force = forces(coarse["position"].values[None], level[None])[0]
    expected = 80e3 * level * volume / fibre_lengths(coarse)
    np.testing.assert_allclose(force, expected, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("stretch", [0.85, 0.97, 1.12])
def test_the_force_is_the_derivative_of_the_energy_by_the_length(coarse, stretch):
    """With equal stretch of all fibres, d(energy of a muscle) = F d(length), by differences.

    The fibre energy of the scene depends on the stretch without the change of volume, which an
    isotropic stretch would cancel: the law is integrated here.
    """
    fibre, rest = MuscleForces.from_face(coarse, PARAMETERS), coarse["position"].values
    level = np.random.default_rng(1).uniform(0.0, 1.0, len(fibre.muscles))
    length = fibre_lengths(coarse)
    h = 1e-6

    def energy(at):
        return np.array([
            (fibre.area[fibre.muscle == k] * length[k] * law.evaluate(np.float64(at), level[k])[0]).sum()
            for k, law in enumerate(fibre.laws)
        ])  # fmt: skip

    slope = (energy(stretch + h) - energy(stretch - h)) / (2.0 * h * length)
    force = fibre(stretch * rest[None], level[None])[0]
    np.testing.assert_allclose(force, slope, rtol=1e-6, atol=1e-9)


def test_the_power_of_a_shortened_muscle_is_that_of_the_scene(coarse):
    """Virtual work of the active stress of one muscle in the scene, under a motion without change of
    volume, is the sum over its elements of the force times the rate of their stretch."""
    names = list(map(str, coarse["muscle"].values))
    k = names.index("ZYG_L")
    system = sim.compile_scene(compose_scene(coarse, PARAMETERS))
    q = coarse["position"].values
    moved = np.stack([0.1 * q[:, 0], -0.05 * q[:, 1], -0.05 * q[:, 2]], axis=1)  # divergence 0

    def internal(level):
        f, activation = np.zeros_like(q), np.zeros(len(names))
        activation[k] = level
        for term in system.terms:
            term.add(q, Control(activation), f)
        return f

    power = -((internal(1.0) - internal(0.0)) * moved).sum()
    forces, h = MuscleForces.from_face(coarse, PARAMETERS), 1e-6
    stretch = [np.linalg.norm((forces.along @ (q + s * h * moved)), axis=1) for s in (1.0, -1.0)]
    rate = (stretch[0] - stretch[1]) / (2.0 * h)
    own = forces.muscle == k
    length = fibre_lengths(coarse)[k]
    level = np.eye(len(names))[k]
    force = forces(q[None], level[None])[0, k]
    assert power == pytest.approx(80e3 * (forces.area[own] * length * rate[own]).sum(), rel=2e-3)
    mean = (forces.area[own] * rate[own]).sum() / forces.area[own].sum()
    assert power == pytest.approx(force * length * mean, rel=2e-3)


@pytest.mark.parametrize("form", ["elements", "lines"])
def test_forces_from_modes_are_those_of_the_positions(coarse, form):
    """For random modes and coordinates; also with laws that differ between the muscles."""
    rng = np.random.default_rng(3)
    forces = MuscleForces.from_face(coarse, PARAMETERS.model_copy(update={"muscle_form": form}))
    if forces.laws:
        laws = (*forces.laws[:7], *(replace(law, sigma_max=20e3) for law in forces.laws[7:]))
        forces = replace(forces, laws=laws)
    rest = coarse["position"].values
    modes = rng.normal(scale=1e-4, size=(*rest.shape, 5))
    y, level = rng.normal(size=(4, 5)), rng.uniform(0.0, 1.0, (4, len(forces.muscles)))
    expected = forces(rest + np.einsum("nar,tr->tna", modes, y), level)
    np.testing.assert_allclose(
        forces.on_modes(rest, modes)(y, level), expected, rtol=1e-9, atol=1e-12
    )
    for k, law in enumerate(forces.laws):  # one by one, by the sum over its rows
        own = forces.muscle == k
        moved = (forces.along @ rest)[own]
        alone = forces.area[own] @ law.evaluate(np.linalg.norm(moved, axis=1), np.float64(0.5))[1]
        at_rest = forces(rest[None], np.full((1, len(forces.muscles)), 0.5))[0, k]
        assert at_rest == pytest.approx(alone, rel=1e-12)


def test_muscles_without_fibre_lines_have_no_force(coarse):
    bare = coarse.drop_dims(["fibre", "fibre_point"])
    forces = MuscleForces.from_face(bare, PARAMETERS)
    assert not forces.known.any()
    assert np.isnan(forces(bare["position"].values[None], np.ones((1, len(forces.muscles))))).all()


def test_muscles_of_lines_have_the_force_of_their_law(coarse):
    parameters = PARAMETERS.model_copy(update={"muscle_form": "lines"})
    forces = MuscleForces.from_face(coarse, parameters)
    level = np.linspace(0.0, 1.0, len(forces.muscles))[None]
    expected = parameters.line_force * level
    np.testing.assert_array_equal(forces(coarse["position"].values[None], level), expected)
    assert forces.known.all()


def test_a_motion_with_a_surface_contains_its_forces(coarse, tmp_path):
    """As evaluated anew from its nodes; in a file, and not without the surface."""
    muscles = list(map(str, coarse["muscle"].values))
    levels = np.array([[0.0, 0.3] if m.endswith("_L") else [0.0, 0.0] for m in muscles])
    drive = xr.Dataset(
        {"activation": (("muscle", "time"), levels, {"units": "1"})},
        {"muscle": muscles, "time": ("time", [0.0, 0.04], {"units": "s"})}, {"origin": "simulated"},
    )  # fmt: skip
    moved = ef.simulate(drive, coarse, accuracy="draft", surface=True, probes=(sim.Positions(),),
                        sigma_max=80e3, progress=False)  # fmt: skip
    forces = moved[MUSCLE_FORCE].transpose("time", "muscle").values
    used = SimulationParameters(accuracy="draft", sigma_max=80e3)
    q = moved["node_position"].transpose("time", "node", "axis").values
    at = np.linspace(0.0, 1.0, len(q))[:, None] * levels[:, 1]
    np.testing.assert_allclose(
        forces, MuscleForces.from_face(coarse, used)(q, at), rtol=1e-9, atol=1e-9
    )
    assert forces[-1, muscles.index("ZYG_L")] > 0.5 > np.abs(forces[-1, muscles.index("ZYG_R")])
    assert (moved["contact_force"].values >= 0.0).all()
    write_netcdf(moved.drop_vars("node_position"), tmp_path / "m.nc", "trajectory")
    again = read_netcdf(tmp_path / "m.nc", "trajectory")
    np.testing.assert_array_equal(again[MUSCLE_FORCE].values, moved[MUSCLE_FORCE].values)
    assert not {MUSCLE_FORCE, "contact_force", "surface_position", "muscle"} & set(
        without_surface(again).variables
    )
    plain = ef.simulate(drive, coarse, accuracy="draft", sigma_max=80e3, progress=False)
    assert MUSCLE_FORCE not in plain and "contact_force" not in plain
    np.testing.assert_array_equal(plain["position"].values, moved["position"].values)
