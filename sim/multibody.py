"""Scenes of rigid bodies without tissue, laid out for the fused steps of `sim._kernels.multibody`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sim._kernels.body_tables import (
    BodyTable,
    PointScratch,
    RowKinds,
    RowScratch,
    Scratch,
    StepScratch,
)
from sim._kernels.joints import RowTable
from sim._kernels.lines import PARAMETERS, LineTable
from sim.bodies import Body
from sim.joints.compiled import CompiledJoints, row_table
from sim.kinematics import Kinematics
from sim.kinematics.articulated import Articulated
from sim.pattern import Index
from sim.scene import CompiledTerm, having
from sim.state import Array, Pose

MOST_DENSE = 240  #: largest number of velocities that are solved for with a dense matrix


@dataclass(frozen=True)
class PointForces:
    """Collected forces of all terms on points."""

    load: Array  #: (n_points, 3) constant forces [N]
    lines: list[tuple[LineTable, Sequence[Index]]] = field(
        default_factory=list[tuple[LineTable, Sequence[Index]]]
    )  #: laws of fibres, and the points of each
    #: point and plane of each, as of `BodyTable`
    morsels: list[tuple[int, Array]] = field(default_factory=list[tuple[int, Array]])


@dataclass(frozen=True, eq=False)
class Multibody:
    """Scene of rigid bodies without tissue."""

    table: BodyTable
    lines: LineTable
    rows: RowTable
    kinds: RowKinds
    led: Index  #: (k,) bodies with a prescribed motion
    eaten: tuple[str, ...]  #: names of the memories of morsels
    n: int  #: number of velocities

    def scratch(self) -> Scratch:
        """Empty memory for steps."""
        n, m, k, p = self.n, len(self.rows.kind), len(self.table.column), len(self.table.body)
        points = {
            **dict.fromkeys(("q", "v", "arm", "force", "carried"), (p, 3)),
            "way": (len(self.table.point), 4),
        }
        step = {
            **dict.fromkeys(("frames", "ahead"), (k, 7)),
            **dict.fromkeys(("sign", "w0", "w1", "p", "r", "g"), (n,)),
            **{"still": (k, 6), "A": (n, n), "I": (3, 3), "inverse": (k, 3, 3)},
        }
        rows = {
            **dict.fromkeys(
                ("c", "drift", "target", "f", "row_force", "positive", "violated"), (m,)
            ),
            **{"G": (m, n), "Y": (m, n), "S": (m, m), "T": (m, m)},
            **{"JA": (m, 6), "JB": (m, 6), "JP": (m, 3)},
        }
        flags, numbers = np.zeros((2, m), dtype=bool), np.zeros((2, m), dtype=np.int64)
        return Scratch(
            PointScratch(**_zeros(points)),
            StepScratch(**_zeros(step)),
            RowScratch(
                **_zeros(rows), on=flags[0], place=numbers[0], chosen=flags[1], near=numbers[1]
            ),
        )


def _zeros(shapes: Mapping[str, tuple[int, ...]]) -> dict[str, Array]:
    return {
        name: np.zeros(shape, order="F" if name in ("A", "T") else "C")
        for name, shape in shapes.items()
    }


def lay_out_multibody(
    kinematics: Kinematics,
    X: Array,
    bodies: Sequence[Body],
    terms: Sequence[CompiledTerm],
    rows: CompiledJoints | None,
    names: Sequence[str],
) -> tuple[Multibody | None, str]:
    """Tables of a scene whose velocities are those of bodies and whose terms act on points.

    X (n_points, 3) are positions at rest [m], and `names` those of the memory of every term. They are
    None for any other scene; if its velocities are those of bodies all the same, the text states what
    prevents the fused step.
    """
    if not isinstance(kinematics, Articulated) or not kinematics.bodies_alone:
        return None, ""
    n = kinematics.pattern.n
    if n > MOST_DENSE:
        return None, f"{n} velocities, more than {MOST_DENSE}"
    forces = PointForces(np.zeros_like(X))
    eaten = list[str]()
    for name, term in zip(names, terms, strict=True):
        if not having([term], "add_to"):
            return (
                None,
                f"{name} has no table of forces on points (`sim.scene.CompiledTerm.add_to`)",
            )
        before = len(forces.morsels)
        term.add_to(forces)
        eaten += [name] * (len(forces.morsels) - before)
    chains = kinematics.chains
    body, arm = np.full(len(X), -1, dtype=np.int64), X.copy()
    body[chains.point], arm[chains.point] = chains.body, chains.arm
    free = kinematics.free_bodies
    inertia = np.zeros((len(bodies), 3, 3))
    inertia[free] = [bodies[int(b)].inertia for b in free]
    inverse = np.zeros_like(inertia)
    inverse[free] = np.linalg.inv(inertia[free])
    paths = [points for _, fibres in forces.lines for points in fibres]
    start = np.cumsum([0, *(len(points) for points in paths)])
    columns = kinematics.body_columns(len(bodies))
    table = BodyTable(
        columns[:-1].copy(),
        np.array([b.mass for b in bodies], dtype=np.float64),
        inertia,
        inverse,
        np.array([b.damping for b in bodies], dtype=np.float64),
        body,
        arm,
        np.where(body < 0, -1, columns[body]).astype(np.int64),
        forces.load,
        start.astype(np.int64),
        np.array([p for points in paths for p in points], dtype=np.int64),
        np.array([point for point, _ in forces.morsels], dtype=np.int64),
        np.array([plane for _, plane in forces.morsels], dtype=np.float64).reshape(-1, 9),
    )
    kept = _row_table(rows, body, arm)
    tables = Multibody(
        table,
        _joined([table for table, _ in forces.lines]),
        *kept,
        kinematics.paths.led,
        tuple(eaten),
        n,
    )
    return tables, ""


def _joined(tables: Sequence[LineTable]) -> LineTable:
    none = np.zeros(0)
    index = none.astype(np.int64)
    laws, relation = np.zeros((0, PARAMETERS)), np.zeros((0, 3))
    first = LineTable(index, none, none, index, laws, none, none, relation)
    return LineTable(*(np.concatenate(column) for column in zip(first, *tables, strict=True)))


def _row_table(rows: CompiledJoints | None, body: Index, arm: Array) -> tuple[RowTable, RowKinds]:
    """Rows with points as places on their bodies."""
    if rows is None:
        none, flags = np.zeros(0), np.zeros(0, dtype=bool)
        return row_table((), {}, Pose(arm, np.zeros((0, 7)), 0.0)), RowKinds(
            flags, flags, none, none
        )
    table = rows.table
    attached = table.point >= 0
    body_b, origin_b = table.body_b.copy(), table.origin_b.copy()
    body_b[attached], origin_b[attached] = body[table.point[attached]], arm[table.point[attached]]
    table = table._replace(point=np.full_like(table.point, -1), body_b=body_b, origin_b=origin_b)
    return table, RowKinds(rows.unilateral, rows.rigid, rows.compliance, rows.damping_time)
