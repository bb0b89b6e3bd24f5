"""Pre-stress by an initial stretch field: the mesh at rest is not stress-free."""

import numpy as np

from sim.compile import compile_scene
from sim.elements import HEX8
from sim.errors import SceneError
from sim.mesh import mesh_from_arrays
from sim.scene import Scene
from sim.state import Array
from sim.system import System
from sim.terms.solid import Material, Solid

IN_VIVO: tuple[float, float] = (15.9e3, 89.4e3)
"""Smallest and largest pre-stress measured in facial skin in vivo [Pa] (Stavness et al.)."""


def initial_stretch(
    material: Material, stress: tuple[float, float, float] | Array, *, steps: int = 20
) -> Array:
    """Principal stretches (3,) [1] for given principal Cauchy stresses of a material.

    Solves sigma_i(stretch) = stress_i, i = 1, 2, 3, by Newton's method for the logarithms of the
    stretches, with the stress applied in equal steps. The stress of the material is computed from
    the nodal forces of one element and is therefore available for every law.

    Parameters
    ----------
    material : Material
        Fully relaxed if it is viscoelastic; material axes are the axes of the stress.
    stress : (3,)
        Along the three axes [Pa], tension positive.
    steps : int
        Number of load steps.

    Raises
    ------
    SceneError
        No equilibrium is found, for example because the law cannot bear the stress.
    """
    goal = np.asarray(stress, dtype=np.float64)
    if not np.isfinite(goal).all():
        _refuse(goal)
    system = _one_element(material)
    y = np.zeros(3)
    for step in range(1, steps + 1):
        target = goal * step / steps
        for _ in range(30):
            miss = target - principal_stress(system, np.exp(y))
            if np.abs(miss).max() <= 1e-9 * max(float(np.abs(goal).max()), 1.0):
                break
            slope = np.empty((3, 3))
            for k in range(3):
                d = np.zeros(3)
                d[k] = 1e-6
                slope[:, k] = principal_stress(system, np.exp(y + d))
                slope[:, k] -= principal_stress(system, np.exp(y - d))
            move = np.linalg.lstsq(slope / 2e-6, miss)[0]
            y = y + np.clip(move, -0.1, 0.1)
            if not np.isfinite(y).all():
                break
        else:
            _refuse(goal)
        if not np.isfinite(y).all():
            _refuse(goal)
    return np.exp(y)


def _refuse(goal: Array) -> None:
    raise SceneError(
        f"no stretch of the material gives the stress {goal} Pa: expected a stress that its law can "
        "bear, try a smaller one or a stiffer material"
    )


def _one_element(material: Material) -> System:
    cube = mesh_from_arrays(0.5 * HEX8.corners, hex8=[range(8)])
    return compile_scene(Scene(cube, (Solid((material,), axes=np.eye(3)[None]),)))


def principal_stress(system: System, stretch: Array) -> Array:
    """Cauchy stresses (3,) [Pa] along the axes of a unit cube of one element under diag(stretch)."""
    X = system.scene.mesh.X
    f = system.force(X * stretch, system.control(np.zeros(0))).f
    return -(f * X).sum(axis=0) * stretch / stretch.prod()


def stretch_field(axes: Array, stretches: Array) -> Array:
    """F0 = sum_i stretch_i a_i a_i' of every element.

    Parameters
    ----------
    axes : (n_elements, 3, 3)
        Orthonormal axes a_i in the rows, in the mesh at rest.
    stretches : (3,) or (n_elements, 3)
        Along the axes [1].
    """
    return np.einsum("...i,eij,eik->ejk", stretches, axes, axes)
