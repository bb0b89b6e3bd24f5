"""Motions of the published tongue compared with those of another simulator, node by node.

Two cases of python -m benchmarks tongue --part reference, and the recorded forces of all elements.
"""

import numpy as np
import pytest

import sim
from benchmarks.tongue import distances, parameters_of, published, recorded, repeated
from emgface.anatomy.tongue.parameters import variant
from emgface.anatomy.tongue.published import TURN
from emgface.anatomy.tongue.scene import tongue_scene


@pytest.fixture(scope="module")
def theirs(shared):
    """The tongue with the fibre directions of that program."""
    return published(shared, "tongue/model_element")


@pytest.mark.parametrize("name", ["lines", "elements"])
@pytest.mark.parametrize("activation", [0.0, 0.3])
def test_forces_of_the_whole_tongue(shared, theirs, name, activation):
    """All muscles alike, at a prescribed displacement, without stiffening: equal up to rounding."""
    system = sim.compile_scene(tongue_scene(theirs, variant(name, gravity=False, stiffening=1.0)))
    control = system.control(np.full(len(system.muscles), activation))
    key = f"force_{name[:-1]}_u{'0p3' if activation else '0'}"
    with np.load(shared / "artisynth_reference" / "tongue" / "internal_force.npz") as arrays:
        moved, expected = arrays["position"] @ TURN.T, arrays[key][:946] @ TURN.T
    q = system.mesh.X.copy()
    q[:946] = moved[:946]
    # two points outside the mesh, in another order
    q[946:] = moved[946:][np.argsort(moved[946:, 0])]
    error = np.abs(system.force(q, control).f[:946] - expected).max()
    assert error < 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize(
    "name", ["line_gravity_SL_0.2", "stable_GGP_0.2", "element_gravity_HG_0.2"]
)
def test_motions_of_the_tongue(theirs, name):
    """Beyond the rounding of recorded positions, which are in single precision [mm].

    Element fibres with the optimal stretch at rest are at a kink of their passive stress, whose side
    depends on rounding in each point of that program. The recorded motion then lies between ours with
    all fibres on one side and on the other.
    """
    case, arrays = recorded(name)
    p, theirs_moved = parameters_of(case), arrays["pos_tongue"]
    motion = repeated(theirs, case, p, 0.2)
    apart = distances(motion, theirs_moved, storage=True).max()
    assert np.linalg.norm(theirs_moved[4] - theirs_moved[0], axis=1).max() > 5e-3
    if p.muscles == "elements" and p.stretch_opt == 1.0:
        other = repeated(theirs, case, p.model_copy(update={"stretch_opt": 1.0 - 1e-9}), 0.2)
        ours = motion["node_position"].transpose("time", "node", "axis").values @ TURN
        between = distances(other, ours).max()
        assert apart < between < 1.0
        assert distances(other, theirs_moved).max() < between
    else:
        assert apart < 1e-6
