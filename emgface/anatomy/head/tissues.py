"""Tissues of a scene, and several of them joined into one."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

import sim
from sim.mesh import Block
from sim.scene import Constraint, Damping, Term


@dataclass(frozen=True, eq=False)
class HeadTissue:
    """Mesh, terms, damping and constraints of one tissue."""

    mesh: sim.Mesh
    terms: tuple[Term, ...]
    damping: Damping | None
    constraints: tuple[Constraint, ...]


def joined_tissues(
    tissues: Sequence[HeadTissue], damping: Callable[..., Damping] = sim.Rayleigh
) -> HeadTissue:
    """Join tissues without common nodes, in the order of their nodes; one alone remains as it is.

    Terms and constant volumes are restricted to the blocks of their own tissue. The `damping` of the
    whole has the coefficients of each tissue at its nodes.
    """
    if len(tissues) == 1:
        return tissues[0]
    if not tissues:
        return HeadTissue(sim.NO_TISSUE, (), None, ())
    X, blocks, terms, constraints = (
        list[np.ndarray](),
        list[Block](),
        list[Term](),
        list[Constraint](),
    )
    for tissue in tissues:
        n, first = sum(map(len, X)), len(blocks)
        X.append(tissue.mesh.X)
        blocks += [Block(block.kind, block.nodes + n) for block in tissue.mesh.blocks]
        terms += [sim.OfBlocks(term, first, len(blocks)) for term in tissue.terms]
        constraints += [sim.HardElementVolume(first, len(blocks))] if tissue.constraints else []
    values = [
        np.concatenate([np.full(t.mesh.n_nodes, getattr(t.damping, name, 0.0)) for t in tissues])
        for name in ("alpha", "beta")
    ]
    mesh = sim.Mesh(np.concatenate(X), tuple(blocks))
    return HeadTissue(mesh, tuple(terms), damping(*values), tuple(constraints))
