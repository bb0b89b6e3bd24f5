"""Forces of the muscles of a system, and their derivatives by the activations."""

from dataclasses import replace

import numpy as np

from sim.errors import SceneError
from sim.scene import CompiledTerm, Index, having
from sim.state import Array, Control, Pose
from sim.system import System, damping_matrix

NEAR = 1e-7  #: displacement of the finite difference of the active stiffness along the step [m]

ALTERED = 0.25
"""Change of one activation for a column: exact where forces are affine in the activation."""

FINE_STEP = 2e-4
"""Change of one activation where they are not, such as those of fibres in series with a tendon."""

LONGER = 1.1
"""Scale of the scene at which muscles that are slack at rest pull [1]."""

AFFINE = 1e-9
"""Curvature of the active forces over their size, above which they are not affine [1]."""


class ActiveForces:
    """Forces of the muscles of a system.

    Attributes
    ----------
    damping_varies : bool
        True if the damping matrix depends on the activation.
    affine : bool
        True if the forces are affine in the activation.
    """

    def __init__(self, system: System) -> None:
        self._system, n = system, len(system.muscles)
        rng = np.random.default_rng(0)
        some = rng.standard_normal(system.mesh.X.shape)
        unequal = rng.uniform(0.5, 1.0, n)  # equal muscles about a point cancel
        q = system.mesh.X + NEAR * some  # no element or fibre is exactly at rest
        tried = q, LONGER * q  # some muscles are slack at rest

        def forces(term: CompiledTerm, level: float) -> Array:
            control, columns = Control(level * unequal), [np.zeros_like(q) for _ in tried]
            for x, f in zip(tried, columns, strict=True):
                term.add(x, control, f)
            return np.array(columns)

        kept = (t for t in system.terms if (forces(t, 0.0) != forces(t, 0.3)).any())
        self._driven = replace(system, terms=tuple(kept))
        self._groups = self._disjoint(n)
        f = [np.sum([forces(t, a) for t in self._driven.terms], axis=0) for a in (0.0, 0.4, 0.8)]
        size = float(np.abs(f[2] - f[0]).max(initial=0.0))
        self.affine = float(np.abs(f[2] - 2.0 * f[1] + f[0]).max(initial=0.0)) <= AFFINE * size
        self.damping_varies = False
        if system.is_damped:
            v = NEAR * some
            rest = system.rest_state().pose
            D = [damping_matrix(system, rest, v, Control(np.full(n, a))) for a in (0.0, 0.3)]
            self.damping_varies = not np.array_equal(D[0].values, D[1].values)

    def columns(self, pose: Pose, control: Control) -> Array:
        """Derivatives (n_muscles, n) of the generalised forces by the activations [N].

        They are differences as of `differences`. Terms that ignore the activation are left out.
        """
        a, kinematics = control.activation, self._system.kinematics
        here = self._driven.force(pose.q, control).f
        out = np.zeros((len(a), self._system.pattern.n))
        for group in self._groups:
            points = {i: self.differences(float(a[i])) for i, _ in group}
            for k in range(len(points[group[0][0]])):
                other = a.copy()
                for i, _ in group:
                    other[i] = points[i][k][0]
                changed = self._driven.force(pose.q, Control(other, control.t)).f - here
                for i, nodes in group:
                    own = np.zeros_like(changed)
                    own[nodes] = points[i][k][1] * changed[nodes]
                    out[i] += kinematics.generalised_force(own, pose)
        return out

    def differences(self, a: float) -> list[tuple[float, float]]:
        """Activations at which a force is compared with that at a, and weights of their differences.

        Their weighted sum is the derivative by the activation: the difference over `ALTERED`, exact for
        affine forces, or of second order in `FINE_STEP`.
        """
        way = 1.0 if a + ALTERED <= 1.0 else -1.0
        if self.affine:
            return [(a + way * ALTERED, way / ALTERED)]
        h = way * FINE_STEP
        return [(a + h, 2.0 / h), (a + 2.0 * h, -0.5 / h)]

    def _disjoint(self, n: int) -> list[list[tuple[int, Index]]]:
        """Groups of muscles, with their nodes, that have no node in common."""
        groups: list[tuple[set[int], list[tuple[int, Index]]]] = []
        everywhere = np.arange(len(self._system.mesh.X))
        local = having(self._driven.terms, "nodes_of_muscle")
        for i in range(n):
            nodes = everywhere
            if len(local) == len(self._driven.terms) > 0:
                nodes = np.unique(np.concatenate([t.nodes_of_muscle(i) for t in local]))
            own = set(nodes.tolist())
            for taken, group in groups:
                if not taken & own:
                    taken |= own
                    group.append((i, nodes))
                    break
            else:
                groups.append((own, [(i, nodes)]))
        return [group for _, group in groups]


def require_affine(system: System, forces: ActiveForces | None = None) -> None:
    """Raise SceneError if passive moduli or the slope of active forces depend on the activation."""
    for term, declared in zip(system.terms, system.scene.terms, strict=True):
        if having([term], "weights"):
            raise SceneError(
                f"the moduli of {type(declared).__name__} depend on the activation, so that a step with "
                "a constant matrix is not affine in it: use form = 'exact'"
            )
    if not (forces or ActiveForces(system)).affine:
        raise SceneError(
            "the forces of muscles are not affine in the activation, as those of fibres in series with "
            "an elastic tendon: use form = 'exact'"
        )
