"""Forces of the muscles of a face [N]: tension along their fibres times their cross-section at rest."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import sparse

from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from sim import LineMuscles, Solid, State, StepReport, System
from sim.laws import FibreLaw, slopes
from sim.probes import Variable
from sim.state import Control, Outputs

Floats = NDArray[np.float64]

MUSCLE_FORCE: Final = "muscle_force"


@dataclass(frozen=True, eq=False)
class MuscleForces:
    """Force of every muscle, (muscle) [N].

    A muscle in elements has the fibre energy E = sum over its elements of weight V w(stretch,
    activation). If all of its fibres are stretched alike, the force conjugate to its length L is

        F = dE/dL = (1 / L) sum over its elements of weight V dw/dstretch,

    with the mean length L of its fibre lines at rest and the stretch |F a0| of the mean deformation
    gradient of each element: the tissue hardly changes its volume, by which the law divides. A muscle
    without fibre lines has no length, and its force is NaN. A muscle of lines with the law
    `sim.ConstantForce` has the force of this law.

    Attributes
    ----------
    muscles : tuple of str
        In the order of the scene.
    along : sparse matrix (n_rows, n_nodes)
        Stretched rest direction of each row F a0 from the positions [m] of the nodes [1/m].
    muscle : array (n_rows,)
        Muscle of each row.
    area : array (n_rows,)
        weight V / L of each row [m^2].
    laws : tuple of FibreLaw
        One per muscle.
    largest : float
        Largest force of a muscle of lines [N], 0 for muscles in elements.
    """

    muscles: tuple[str, ...]
    along: sparse.csr_array
    muscle: NDArray[np.int64]
    area: Floats
    laws: tuple[FibreLaw, ...]
    largest: float = 0.0

    @property
    def known(self) -> NDArray[np.bool_]:
        """Muscles (n_muscles,) whose force is not NaN."""
        if self.largest > 0.0:
            return np.ones(len(self.muscles), dtype=bool)
        return np.isfinite(np.bincount(self.muscle, self.area, len(self.muscles)))

    @classmethod
    def from_face(cls, face: xr.Dataset, parameters: SimulationParameters) -> "MuscleForces":
        """Forces of the muscles of a face with the mechanics of the parameters."""
        scene = compose_scene(face, parameters)
        names = tuple(map(str, face["muscle"].values))
        none = sparse.csr_array((0, scene.mesh.n_nodes))
        if any(isinstance(term, LineMuscles) for term in scene.terms):
            empty = np.zeros(0, dtype=np.int64)
            return cls(names, none, empty, np.zeros(0), (), parameters.line_force)
        solid = next(term for term in scene.terms if isinstance(term, Solid))
        muscles, mesh = solid.muscles, scene.mesh
        assert muscles is not None  # of this form
        direction = muscles.direction / np.linalg.norm(muscles.direction, axis=1, keepdims=True)
        if solid.prestretch is not None:
            # The direction before the prestretch F0 is F0^-1 a0, normalised.
            before = np.linalg.solve(solid.prestretch[muscles.element], direction[..., None])
            direction = direction / np.linalg.norm(before[..., 0], axis=1, keepdims=True)
        rows, columns, values = [], [], []
        volume, first = np.zeros(len(muscles.element)), 0
        for block in mesh.blocks:
            gradient, det = block.gradients(mesh.X)
            share = det * block.kind.weights
            mean = np.einsum("ep,epai->eai", share, gradient) / share.sum(axis=1)[:, None, None]
            own = np.flatnonzero(
                (muscles.element >= first) & (muscles.element < first + len(block.nodes))
            )
            element = muscles.element[own] - first
            volume[own] = share.sum(axis=1)[element]
            values.append(np.einsum("bai,bi->ba", mean[element], direction[own]).ravel())
            columns.append(block.nodes[element].ravel())
            rows.append(np.repeat(own, block.kind.n_nodes))
            first += len(block.nodes)
        parts = tuple(map(np.concatenate, (values, rows, columns)))
        along = sparse.csr_array(
            (parts[0], (parts[1], parts[2])), shape=(len(volume), mesh.n_nodes)
        )
        weight = np.ones(len(volume)) if muscles.weight is None else muscles.weight
        area = weight * volume / fibre_lengths(face)[muscles.muscle]
        return cls(names, along, muscles.muscle, area, muscles.laws())

    def variables(self) -> tuple[Variable, ...]:
        """Describe the recorded variable."""
        return (Variable(MUSCLE_FORCE, "N", ("muscle",), {"muscle": self.muscles}),)

    def record(
        self, system: System, state: State, control: Control, report: StepReport | None
    ) -> tuple[Floats, ...]:
        """Forces of a state."""
        return (self(state.q[None], control.activation[None])[0],)

    def record_all(
        self, system: System, outputs: Outputs, activation: Floats
    ) -> tuple[Floats, ...]:
        """Forces at several outputs."""
        return (self(outputs.q, activation),)

    def __call__(self, q: Floats, activation: Floats) -> Floats:
        """Forces (t, n_muscles) [N] at positions (t, n_nodes, 3) [m] and activations (t, n_muscles)."""
        if self.largest > 0.0:
            return self.largest * activation
        moved = np.ascontiguousarray(q.transpose(1, 0, 2)).reshape(q.shape[1], -1)
        return self.of_directions((self.along @ moved).reshape(-1, len(q), 3), activation)

    def of_directions(self, moved: Floats, activation: Floats) -> Floats:
        """Forces (t, n_muscles) [N] for the directions F a0 of the rows (n_rows, t, 3)."""
        stretch, level = np.linalg.norm(moved, axis=2), activation.T[self.muscle]
        slope = np.zeros_like(stretch)
        for law in dict.fromkeys(self.laws):
            used = np.array([other == law for other in self.laws])
            own = slice(None) if used.all() else used[self.muscle]
            slope[own] = slopes(law, stretch[own], level[own])
        summed = sparse.csr_array(
            (self.area, (self.muscle, np.arange(len(self.area)))),
            shape=(len(self.muscles), len(self.area)),
        )
        return (summed @ slope).T

    def on_modes(self, rest: Floats, modes: Floats) -> "ModalForces":
        """Forces from the coordinates of modes (n_nodes, 3, r) about positions (n_nodes, 3) [m]."""
        rows, r = self.along.shape[0], modes.shape[2]
        along = self.along @ modes.reshape(len(modes), -1)
        return ModalForces(self, self.along @ rest, along.reshape(3 * rows, r))


@dataclass(frozen=True, eq=False)
class ModalForces:
    """Forces of muscles from the coordinates y of a reduced face: F a0 is linear in them.

    Attributes
    ----------
    forces : MuscleForces
    rest : array (n_rows, 3)
        F a0 of each row where the coordinates are zero.
    modes : array (3 n_rows, r)
        Its derivative by the coordinates.
    """

    forces: MuscleForces
    rest: Floats
    modes: Floats

    def __call__(self, y: Floats, activation: Floats) -> Floats:
        """Forces (t, n_muscles) [N] at coordinates (t, r) and activations (t, n_muscles)."""
        if self.forces.largest > 0.0:
            return self.forces.largest * activation
        change = (self.modes @ y.T).reshape(len(self.rest), 3, len(y)).transpose(0, 2, 1)
        return self.forces.of_directions(self.rest[:, None] + change, activation)


def fibre_lengths(face: xr.Dataset) -> Floats:
    """Mean length of the fibre lines of every muscle at rest (n_muscles,) [m], NaN without lines."""
    count = face.sizes["muscle"]
    if "fibre_position" not in face or not face.sizes["fibre_point"]:
        return np.full(count, np.nan)
    points, owner = face["fibre_position"].values, face["fibre_of_point"].values
    pieces = np.linalg.norm(np.diff(points, axis=0), axis=1) * (owner[1:] == owner[:-1])
    muscle = face["fibre_muscle"].values.astype(np.int64)
    total = np.bincount(muscle[owner[1:]], pieces, count)
    number = np.bincount(muscle, minlength=count).astype(np.float64)
    length = np.divide(total, number, out=np.full(count, np.nan), where=number > 0.0)
    return np.where(length > 0.0, length, np.nan)
