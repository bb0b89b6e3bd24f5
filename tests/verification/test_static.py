"""Quasi-static equilibrium, load stepping and volumetric locking."""

import numpy as np
import pytest

import sim
from benchmarks.locking import PARTS, beam, cook
from tests.bodies import crossed_muscles, fixed_block, free_components, grid, solid_system


def muscle_block(sigma_max=30e3):
    mesh, damping = grid((2, 2, 2), wedges=(1,)), sim.RestRayleigh(19.0, 0.02)
    return fixed_block(mesh, sim.Blemker(sigma_max), terms=(sim.Gravity(),), damping=damping)


def ramp(system, peak):
    top = np.full(len(system.muscles), peak)
    return sim.Activation(np.array([0.0, 1.0]), np.array([0.0 * top, top]))


def test_the_static_equilibrium_is_the_end_of_the_dynamics():
    system = muscle_block()
    activation = ramp(system, 0.5)
    _, static = sim.simulate(
        system, activation, duration=1.0, integrator=sim.Static(), steps=sim.HalvingStep(0.25)
    )
    _, dynamic = sim.simulate(system, activation, duration=4.0, steps=sim.FixedStep(0.05))
    assert np.abs(dynamic.v).max() < 1e-6
    assert np.abs(static.q - dynamic.q).max() < 1e-6
    f = free_components(system, system.force(static.q, system.control(activation.at(1.0))).f)
    assert np.abs(f).max() <= 1e-6


def test_a_load_too_large_for_one_step_is_applied_in_several():
    system = muscle_block(1000e3)
    trajectory, end = sim.simulate(
        system,
        ramp(system, 1.0),
        duration=1.0,
        integrator=sim.Static(max_iterations=8),
        steps=sim.HalvingStep(1.0),
        probes=(sim.SmallestJ(), sim.Iterations()),
    )
    assert trajectory.rejected[-1] > 0
    assert trajectory.smallest_J[-1] > 0.0
    control = system.control(np.ones(2))
    assert np.abs(free_components(system, system.force(end.q, control).f)).max() <= 1e-6


@pytest.mark.parametrize("poisson", [0.3, 0.49, 0.4999, 0.49999])
def test_locking_of_a_beam_is_shown_and_avoided(poisson):
    # Linear hexahedra of this mesh are too stiff in bending because of shear locking. Without
    # volumetric locking the deflection is that of the compressible beam.
    reference = beam(4, 0.3, "pointwise")
    for part in ("element", "nodal") + (("hard",) if poisson > 0.48 else ()):
        assert beam(4, poisson, part) == pytest.approx(reference, rel=0.15), part
    if poisson >= 0.4999:
        assert beam(4, poisson, "pointwise") < 0.5 * reference


def test_refinement_of_the_unlocked_beam_approaches_beam_theory():
    coarse, fine = (beam(cells, 0.4999, "element") for cells in (2, 6))
    assert coarse < fine < 1.05
    assert fine > 0.85


def test_locking_of_cooks_membrane_is_shown_and_avoided():
    """Element, nodal and hard volumes converge to one displacement; the pointwise law does not."""
    deflections = {part: [cook(n, 0.4999, part) for n in (4, 8, 16)] for part in PARTS}
    coarse, middle, hard = deflections["hard"]
    ratio = (middle - coarse) / (hard - middle)
    limit = hard + (hard - middle) / (ratio - 1.0)  # Richardson
    assert 2.0 < ratio < 4.0  # The singularity at the corner reduces the order.
    assert deflections["element"][-1] == pytest.approx(limit, rel=0.03)
    assert deflections["nodal"][-1] == pytest.approx(limit, rel=0.08)
    assert deflections["pointwise"][-1] < 0.35 * limit


def test_hard_volumes_are_constant_and_agree_with_the_soft_limit():
    """Dynamics of a contracting block: every element has a constant volume."""
    mesh = grid((2, 2, 2), wedges=(1,))
    base = sim.Fixed(np.flatnonzero(mesh.X[:, 2] == 0.0))

    def end(kappa):
        system = solid_system(
            mesh,
            bulk=sim.QuadraticBulk(0.0),
            muscles=crossed_muscles(mesh, sim.Blemker(30e3)),
            terms=() if kappa is None else (sim.ElementVolume(kappa),),
            reductions=(base,),
            # Stiffness damping at rest would resist large motions that preserve the volumes.
            damping=sim.RestRayleigh(19.0, 0.0),
            constraints=(sim.HardElementVolume(),) if kappa is None else (),
        )
        _, state = sim.simulate(system, ramp(system, 0.5), duration=0.1, steps=sim.FixedStep(0.01))
        return system, state

    system, state = end(None)
    q = state.q
    moved = np.abs(q - mesh.X).max()
    volume = system.constraints.evaluate(state.pose)[0]
    assert np.abs(volume).max() < 1e-8 * mesh.volumes().min()
    gaps = [np.abs(end(kappa)[1].q - q).max() for kappa in (1e5, 1e6, 1e7)]
    assert gaps[2] < 0.02 * moved
    assert gaps[1] < 0.2 * gaps[0]
    assert gaps[2] < 0.2 * gaps[1]
