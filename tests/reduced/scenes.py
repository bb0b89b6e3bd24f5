"""Block of tissue with two muscles, and bases of its motion."""

from functools import cache

import numpy as np

import sim
from sim.reduced import mass_modes, static_responses

STEP = 0.01


@cache
def block(gravity: bool = True, damped: bool = True) -> sim.System:
    """Block of 4 x 2 x 2 hexahedra, fixed at x = 0, with a muscle in the left and the right half."""
    axes = np.meshgrid(np.arange(5), np.arange(3), np.arange(3), indexing="ij")
    mesh = sim.grid_mesh(5e-3 * np.stack(axes, axis=-1).astype(float))
    middle = mesh.X[mesh.blocks[0].nodes].mean(axis=1)
    left = np.flatnonzero(middle[:, 1] < 5e-3)
    right = np.flatnonzero(middle[:, 1] > 5e-3)
    muscles = sim.Muscles(
        ("left", "right"),
        np.concatenate([left, right]),
        np.repeat([0, 1], [len(left), len(right)]),
        np.tile([[1.0, 0.0, 0.0]], (len(left) + len(right), 1)),
        sim.Blemker(50e3),
    )
    terms = (sim.Solid(muscles=muscles), *([sim.Gravity()] if gravity else []))
    fixed = sim.Fixed(np.flatnonzero(mesh.X[:, 0] == 0.0))
    damping = sim.RestRayleigh() if damped else None
    return sim.compile_scene(sim.Scene(mesh, terms, reductions=(fixed,), damping=damping))


def drive(*levels: float) -> sim.Activation:
    """Ramp of both muscles within 0.1 s."""
    return sim.Activation(np.array([0.0, 0.1]), np.array([[0.0] * len(levels), levels]))


def full_motion(system, activation, duration=0.3, integrator=None):
    """Positions (times, n_nodes, 3) at full order."""
    return sim.simulate(
        system,
        activation,
        duration=duration,
        integrator=integrator or sim.LinearlyImplicitEuler(),
        steps=sim.FixedStep(STEP),
        probes=(sim.Positions(),),
    )[0].node_position.transpose("time", "node", "axis")


@cache
def snapshots() -> tuple[np.ndarray, np.ndarray]:
    """Displacements and activations of the training: each muscle, and both."""
    system, moved, levels = block(), [], []
    for level in ((0.8, 0.0), (0.0, 0.8), (0.6, 0.6), (0.3, 0.7), (0.7, 0.3)):
        activation = drive(*level)
        motion = full_motion(system, activation)
        moved.append(motion.values[1:] - system.mesh.X)
        levels.append(np.array([activation.at(t) for t in motion.time.values[1:]]))
    return np.concatenate(moved), np.concatenate(levels)


@cache
def basis(n: int) -> np.ndarray:
    """First n modes of the training and of the static responses."""
    system = block()
    moved = np.concatenate([snapshots()[0], static_responses(system, system.mesh.X)])
    return mass_modes(moved, system.node_mass, n)[0]
