"""Scenes of one particle held by muscles, and the runs that another simulator recorded of them."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import sim
from sim.inverse import PointTarget
from sim.scene import CompiledTerm, Contribution, Term


def particle(ends: np.ndarray, term, damping: float = 0.0) -> tuple[sim.System, int]:
    """Compile a particle of 1 g at the origin, whose muscles of `term` end at fixed points."""
    body = sim.Body("particle", 1e-3, 1e-3 * np.eye(3), np.zeros(3), (damping, 0.0))
    fixed = sim.Fixed(np.arange(len(ends)))
    scene = sim.Scene(sim.NO_TISSUE, (term,), (fixed,), bodies=(body,), points=ends)
    return sim.compile_scene(scene), len(ends)


def circle(radius: float, n: int = 16) -> np.ndarray:
    angle = np.pi / 2 - np.arange(n) * 2.0 * np.pi / n
    return radius * np.stack([np.cos(angle), 0.0 * angle, np.sin(angle)], axis=1)


def constant_muscles(ends: np.ndarray, damping: float = 1.0) -> sim.LineMuscles:
    fibres = [sim.LineFibre(k, np.array([k, len(ends)])) for k in range(len(ends))]
    names = tuple(f"m{k}" for k in range(len(ends)))
    return sim.LineMuscles(names, fibres, sim.ConstantForce(1.0), damping=damping)


@dataclass(frozen=True)
class LinearTension(Term):
    """Muscles from fixed points to a particle with tension F f(l) (a + passive) + damping dl/dt.

    f rises from 0 at the length `optimal` to 1 at `longest`. Written from the recorded parameters.
    """

    names: tuple[str, ...]
    force: float
    passive: float
    optimal: float
    longest: float
    damping: float

    def muscle_names(self):
        return self.names

    def pair_keys(self, mesh):
        last = len(self.names)
        return np.array([last * mesh.n_nodes + last])

    def compile(self, layout):
        return _Compiled(self, layout)


class _Compiled(CompiledTerm):
    def __init__(self, term, layout):
        self.term, self.last = term, len(term.names)
        pair = layout.pattern.pair_index(np.array([self.last * layout.mesh.n_nodes + self.last]))
        self.target = layout.pattern.target[pair[0]].reshape(3, 3)

    def _parts(self, q, control):
        t, d = self.term, q[self.last] - q[: self.last]
        length = np.linalg.norm(d, axis=1)
        span = t.longest - t.optimal
        f = np.clip((length - t.optimal) / span, 0.0, 1.0)
        drive = t.force * (control.activation + t.passive)
        slope = drive * ((length > t.optimal) & (length < t.longest)) / span
        return d / length[:, None], length, drive * f, slope

    def _add(self, values, blocks):
        stored = self.target >= 0
        np.add.at(values, self.target[stored], blocks.sum(axis=0)[stored])

    def add(self, q, control, f, K=None):
        unit, length, tension, slope = self._parts(q, control)
        f[self.last] -= tension @ unit
        if K is not None:
            outer = unit[:, :, None] * unit[:, None, :]
            across = (tension / length)[:, None, None] * (np.eye(3) - outer)
            self._add(K, slope[:, None, None] * outer + across)
        return Contribution(0.0)

    def add_damping(self, q, control, D):
        unit, *_ = self._parts(q, control)
        self._add(D, self.term.damping * unit[:, :, None] * unit[:, None, :])


def recorded(folder: Path, name: str):
    """System, target and recorded run of a point model, in the units of the model."""
    message = json.loads((folder / f"{name}.json").read_text())
    run = np.load(folder / f"{name}.npz")
    muscles = message["model"]["muscles"]
    p = muscles[0]["props"]
    term = LinearTension(
        tuple(m["name"] for m in muscles),
        p["maxForce"], p["passiveFraction"], p["optLength"], p["maxLength"], p["damping"],
    )  # fmt: skip
    ends = np.array([m["p1"] for m in muscles])
    system, last = particle(ends, term, message["model"]["point_damping"])
    time = np.concatenate([[0.0], run["t"]])
    position = np.concatenate([np.zeros((1, 1, 3)), run["target"]])
    return system, PointTarget(np.array([last]), time, position, 1.0), run, message
