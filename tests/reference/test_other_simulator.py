"""Single elements and material points against results recorded with another simulator.

Provenance: ArtiSynth 3.9 (see the README of the data); the cases without volumetric part
compare the deviatoric and fibre laws, the shape functions, the quadrature and the assembled
tangent.
"""

import json
from dataclasses import replace

import numpy as np
import pytest

import sim
from benchmarks.other_simulator import CASES, their_face
from tests.bodies import dense, grid, mean_stress, solid_system

THEIR_HEX = [
    3,
    2,
    1,
    0,
    7,
    6,
    5,
    4,
]  # their order of the faces of a hexahedron is opposite
FIBRE_LAWS = {"BlemkerMuscle": sim.Blemker, "GenericMuscle": sim.Generic}
ROUNDING = 1e-10  # relative: two double-precision programs, sums in different order


@pytest.fixture(scope="module")
def unit(shared):
    folder = shared / "artisynth_reference" / "unit"
    return {
        name: json.loads((folder / f"unit_{name}.json").read_text())
        for name in ("elements", "material_points")
    }


def fibre_law(description):
    law = FIBRE_LAWS[description["type"]]
    return law(sigma_max=description["maxStress"])


def stress_of(F, direction, muscle, activation):
    """Cauchy stress of the passive law, or of the muscle alone, without volumetric part."""
    mesh = grid((1, 1, 1))
    bulk = sim.QuadraticBulk(0.0)
    passive = mean_stress(solid_system(mesh, bulk=bulk), F, [])
    if muscle is None:
        P = passive
    else:
        rows = sim.Muscles(
            ("m",), np.array([0]), np.array([0]), np.array([direction]), fibre_law(muscle)
        )
        P = mean_stress(solid_system(mesh, bulk=bulk, muscles=rows), F, [activation]) - passive
    return P @ F.T / np.linalg.det(F)


def test_material_points(unit):
    cases = unit["material_points"]["cases"]
    assert len(cases) > 3
    for case in cases:
        F = np.array(case["F"])
        expected = np.array(case["MR_dev"]["sigma"])
        scale = max(np.abs(expected).max(), 2500.0)
        sigma = stress_of(F, None, None, 0.0)
        np.testing.assert_allclose(sigma, expected, atol=ROUNDING * scale)
        for muscle in case["muscle"]:
            expected = np.array(muscle["sigma"])
            sigma = stress_of(F, case["dir0"], muscle["material"], muscle["excitation"])
            scale = muscle["material"]["maxStress"]
            np.testing.assert_allclose(sigma, expected, atol=ROUNDING * scale)


VOLUME = {"OFF": (), "ELEMENT": (sim.ElementVolume(25e3),), "NODAL": (sim.NodalVolume(25e3),)}


def system_and_positions(case):
    """Scene of the case, and its positions in the node order of the file."""
    rest, q = np.array(case["rest"]), np.array(case["pos"])
    kinds = {"hex": ("hex8", THEIR_HEX), "wedge": ("wedge6", [0, 1, 2, 3, 4, 5])}
    if "connectivity" in case:
        blocks = {"hex8": [], "wedge6": []}
        rows = []
        for nodes in case["connectivity"]:
            name, order = kinds["hex" if len(nodes) == 8 else "wedge"]
            blocks[name].append([nodes[i] for i in order])
            rows.append((name, len(blocks[name]) - 1))
        element = np.array([i if name == "hex8" else len(blocks["hex8"]) + i for name, i in rows])
    else:
        name, order = kinds[case["element"]]
        blocks, element = {name: [order]}, np.array([0])
    mesh = sim.mesh_from_arrays(rest, **{k: v for k, v in blocks.items() if v})
    muscles = None
    if case["muscle"]:
        law = fibre_law(
            case["muscle"]
            if isinstance(case["muscle"], dict)
            else {"type": f"{case['muscle'].capitalize()}Muscle", "maxStress": 1e5}
        )
        direction = np.broadcast_to(case["direction"], (len(element), 3))
        muscles = sim.Muscles(("m",), element, np.zeros(len(element), int), direction, law)
    fixed = sim.Fixed(np.array(case.get("fixed", []), dtype=int))
    bulk, volume = sim.QuadraticBulk(0.0), VOLUME[case["soft"]]
    system = solid_system(mesh, None, bulk, muscles, reductions=(fixed,), terms=volume)
    activation = np.array([case["excitation"]]) if muscles else np.zeros(0)
    return system, q, system.control(activation), element


@pytest.mark.parametrize("soft", VOLUME)
def test_forces_and_stiffness_of_elements(unit, soft):
    cases = [c for c in unit["elements"]["cases"] if c["soft"] == soft]
    names = [c["name"] for c in cases]
    assert {"hex", "wedge"} <= {n.split("_")[0] for n in names}
    for case in cases:
        system, q, control, element = system_and_positions(case)
        volumes = system.scene.mesh.volumes()[element]
        np.testing.assert_allclose(volumes, case["element_rest_volume"], rtol=1e-12)
        np.testing.assert_allclose(system.node_mass, case["node_mass"], rtol=1e-12)
        evaluation, K = system.tangent(q, control)
        expected = np.array(case["internal_force"])
        error = np.abs(-evaluation.f - expected).max() / np.abs(expected).max()
        assert error < ROUNDING, (case["name"], error)
        stiffness = np.array(case["stiffness_active"])
        error = np.abs(dense(system, K) - stiffness).max() / np.abs(stiffness).max()
        assert error < ROUNDING, (case["name"], error)


def pointwise(system, kappa):
    """The same scene with a quadratic bulk law at every Gauss point."""
    solid, *others = system.scene.terms
    material = replace(solid.materials[0], bulk=sim.QuadraticBulk(kappa))
    return sim.compile_scene(
        replace(system.scene, terms=(replace(solid, materials=(material,)), *others))
    )


def bulk_blocks(system, q, modulus):
    """Sum over Gauss points of modulus(J) v grad N grad N', dense over the free unknowns."""
    A = np.zeros((q.size, q.size))
    mesh = system.scene.mesh
    for block in mesh.blocks:
        gradient, det = block.gradients(mesh.X)
        for nodes, gradients, volumes in zip(
            block.nodes, gradient.transpose(0, 1, 3, 2), det * block.kind.weights, strict=True
        ):
            unknowns = (3 * nodes[:, None] + np.arange(3)).ravel()
            for G, V in zip(gradients, volumes, strict=True):
                F = q[nodes].T @ G.T
                J = np.linalg.det(F)
                g = (np.linalg.inv(F).T @ G).T.ravel()
                A[np.ix_(unknowns, unknowns)] += modulus(J) * J * V * np.outer(g, g)
    return A[np.ix_(system.free, system.free)]


def test_pointwise_bulk_of_elements(unit):
    """Forces are equal; the tangent of that program has kappa/J instead of kappa J, the derivative of
    p = kappa (J - 1). With this replacement the stiffness is equal, too.
    """
    kappa = 25e3
    cases = [c for c in unit["elements"]["cases"] if c["soft"] == "FULL"]
    assert len(cases) == 8
    for case in cases:
        bare, q, control, _ = system_and_positions({**case, "soft": "OFF"})
        system = pointwise(bare, kappa)
        evaluation, K = system.tangent(q, control)
        expected = np.array(case["internal_force"])
        assert np.abs(-evaluation.f - expected).max() < ROUNDING * np.abs(expected).max()
        theirs = dense(system, K) + bulk_blocks(system, q, lambda J: kappa / J - kappa * J)
        stiffness = np.array(case["stiffness_active"])
        error = np.abs(theirs - stiffness).max() / np.abs(stiffness).max()
        assert error < ROUNDING, (case["name"], error)


SCHEMES = {
    "ConstrainedBackwardEuler": sim.LinearlyImplicitEuler,
    "Trapezoidal": sim.LinearlyImplicitTrapezoidal,
}


@pytest.mark.parametrize("scheme", SCHEMES)
def test_trajectories_of_the_patch(shared, unit, scheme):
    """One solution per step, 40 steps, every treatment of the volume: equal up to rounding."""
    folder = shared / "artisynth_reference" / "unit"
    cases = json.loads((folder / "unit_dynamics.json").read_text())["cases"]
    patch = next(c for c in unit["elements"]["cases"] if c["name"] == "patch_ELEMENT_blemker")
    # With hard incompressibility the other program keeps its soft pressure: the multipliers replace
    # its force, but not its small geometric stiffness.
    soft = {"softNODAL": "NODAL", "softELEMENT": "ELEMENT", "hardELEMENT": "ELEMENT"}
    cases = [c for c in cases if c["integrator"] == scheme]
    assert len(cases) == 6
    for case in cases:
        scene = system_and_positions(
            {**patch, "soft": soft[case["incomp"]], "muscle": case["muscle"]}
        )[0].scene
        gravity = (sim.Gravity((0.0, 0.0, case["gravity_z"])),) if case["gravity_z"] else ()
        system = sim.compile_scene(
            replace(
                scene,
                terms=scene.terms + gravity,
                damping=sim.Rayleigh(19.0, 0.055),
                constraints=(sim.HardElementVolume(),) if case["incomp"] == "hardELEMENT" else (),
            )
        )
        state, work = system.rest_state(), sim.Workspace(system)
        control = system.control(np.array([case["excitation"]]))
        for step in range(1, max(map(int, case["steps"])) + 1):
            state, _ = SCHEMES[scheme]().step(system, state, control, case["h"], work)
            if str(step) in case["steps"]:
                expected = np.array(case["steps"][str(step)]["pos"])
                error = np.abs(state.q - expected).max()
                assert error < 1e-12, (case["incomp"], case["muscle"]["type"], step, error)


@pytest.mark.parametrize("soft", ["ELEMENT", "NODAL"])
@pytest.mark.parametrize("activation", [None, 0.3])
def test_forces_of_the_whole_face(shared, soft, activation):
    name = "A_softnodal_blemker_ZYG" if soft == "NODAL" else "C_softelem_blemker_ZYG"
    case = next(case for case in CASES if case.name == name)
    system = their_face(shared / "artisynth_reference", case)
    if activation is None:
        solid, *others = system.scene.terms
        bare = replace(system.scene, terms=(replace(solid, muscles=None), *others), damping=None)
        system = sim.compile_scene(bare)
    data = np.load(shared / "artisynth_reference" / "full_internal_force.npz")
    model = json.loads((shared / "artisynth_reference" / "refmodel_model.json").read_text())
    np.testing.assert_allclose(system.node_mass, model["node_mass"], rtol=1e-12)
    control = system.control(np.full(len(system.muscles), activation or 0.0))
    name = "nomuscle" if activation is None else f"allmuscles{activation}"
    expected = data[f"force_{soft}_{name}"]
    error = np.abs(-system.force(data["pos"], control).f - expected).max()
    assert error < 1e-12 * np.abs(expected).max()
