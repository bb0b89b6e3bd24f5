"""Tables and memory of the fused step of rigid bodies.

Each function of a kernel receives the arrays that it uses, because numba passes every number of every
array of a tuple by itself: whole tables doubled the time of compilation.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]


class BodyTable(NamedTuple):
    """Bodies, points on them, and paths of fibres.

    column : (n_bodies,) first velocity of every body, -1 where it is not free.
    mass, inertia, inverse, damping : (n_bodies,), (n_bodies, 3, 3) in the axes of the body, its inverse,
        and (n_bodies, 2).
    body, arm : body of every point, -1 for space, and its place in the axes of the body [m].
    first : (n_points,) first velocity of the body of every point, -1 where it is not free.
    load : (n_points, 3) constant forces [N].
    start, point : points start[k]..start[k + 1] of fibre k, entries of `point`.
    morsel, plane : points of morsels, and (k, 9) of each: place and normal of its plane, fixed in space,
        diameter [m], largest force [N] and damping [N s/m], as `sim.Crushable`.
    """

    column: Index
    mass: Array
    inertia: Array
    inverse: Array
    damping: Array
    body: Index
    arm: Array
    first: Index
    load: Array
    start: Index
    point: Index
    morsel: Index
    plane: Array


class RowKinds(NamedTuple):
    """Kinds of rows, as of `sim.joints.compiled.Rows`."""

    unilateral: Flags
    rigid: Flags
    compliance: Array
    damping_time: Array


class PrescribedBodies(NamedTuple):
    """Prescribed bodies (k,), with frames (n, k, 7) and twists (n, k, 6) at the ends of steps."""

    body: Index
    frames: Array
    twists: Array


class PointScratch(NamedTuple):
    """Memory of a step for p points, and direction and length of the segments of fibres."""

    q: Array
    v: Array
    arm: Array
    force: Array
    carried: Array
    way: Array


class StepScratch(NamedTuple):
    """Memory of a step for n velocities and k bodies; A is stored by columns."""

    frames: Array
    ahead: Array
    still: Array
    A: Array
    sign: Array
    w0: Array
    w1: Array
    p: Array
    r: Array
    g: Array
    I: Array  # noqa: E741
    inverse: Array


class RowScratch(NamedTuple):
    """Memory of a step for m rows, some `chosen`, with the numbers `near`; T is stored by columns."""

    G: Array
    Y: Array
    S: Array
    T: Array
    c: Array
    drift: Array
    target: Array
    f: Array
    row_force: Array
    positive: Array
    JA: Array
    JB: Array
    JP: Array
    violated: Array
    on: Flags
    place: Index
    chosen: Flags
    near: Index


class Scratch(NamedTuple):
    """Memory of a step, all of it zero at first."""

    points: PointScratch
    step: StepScratch
    rows: RowScratch
