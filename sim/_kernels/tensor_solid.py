"""Element loop of the second family: laws of the whole strain tensor, with fibres and bulk law.

At every point the stresses S and moduli D of all laws are summed (`sim._kernels.tensor_point`);
then all points together are transformed to natural coordinates (`sim._kernels.tensor_element`).

A law of small strain has F = I and no term of the stress in the moduli. A viscoelastic law
contributes scale * (law) + history, a stress that is constant over the step; both are given by the
caller.
"""

# pyright: basic, reportAttributeAccessIssue=false, reportCallIssue=false
# numba compiles these functions; those called from Python carry types

import math
from typing import NamedTuple

import numpy as np

from sim._kernels.element import (
    BLOCKS,
    NODES,
    Indices,
    Part,
    Reals,
    clear,
    least,
    natural,
    nodal,
    put,
    stiffness_blocks,
)
from sim._kernels.lanes import load, rows, store, total
from sim._kernels.laws import FibreTable, bulk
from sim._kernels.options import by_chunk, by_colour, in_threads, inner
from sim._kernels.scatter import Places, add_to_matrix, fetch_matrix, subtract_from_nodes
from sim._kernels.tensor_element import (
    BLOCK_ROW,
    COFACTOR_ROW,
    D_ROW,
    F_ROW,
    J_ROW,
    MODULI_ROW,
    P_ROW,
    S_ROW,
    SMALL_D_ROW,
    SMALL_S_ROW,
    TENSOR_ROWS,
    W_ROW,
    add_geometric,
    add_moduli,
    all_rest,
    deform,
    first_stress,
    strain_rows,
)
from sim._kernels.tensor_laws import SMALL_STRAIN
from sim._kernels.tensor_point import (
    add_fibre,
    add_product,
    passive_law,
    point_scratch,
    project,
    strains,
)


class TensorLawTable(NamedTuple):
    """Laws of materials, and the material of every element.

    region : row of the material.
    measure, code, p : strain measures, codes and parameters (rows) of the laws.
    bulk_code, kappa : of the bulk laws.
    """

    region: Indices
    measure: Indices
    code: Indices
    p: Reals
    bulk_code: Indices
    kappa: Reals


@inner
def _deformation_at(w, k, F, cof):
    """F (3, 3) and its cofactor at point k, from their rows; J."""
    for i in range(3):
        for j in range(3):
            F[i, j] = w[F_ROW + 3 * i + j, k]
            cof[i, j] = w[COFACTOR_ROW + 3 * i + j, k]
    return w[J_ROW, k]


@inner
def _add_history(history, strain, S):
    """Add the constant stress (6,) to S; its energy for a strain given as I + 2 E."""
    W = 0.0
    for a in range(6):
        one = 1.0 if a < 3 else 0.0
        S[a] += history[a]
        W += history[a] * (0.5 * (strain[a] - one)) * (1.0 if a < 3 else 2.0)
    return W


@inner
def _add_bulk(code, kappa, J, inverse, S, D, with_tangent):
    """Add stress and moduli of the bulk law; its energy."""
    U, UJ, UJJ = bulk(code, kappa, J)
    for a in range(6):
        S[a] += UJ * J * inverse[a]
    if with_tangent:
        add_product(D, inverse, J * UJ + J * J * UJJ, -2.0 * J * UJ)
    return U


@inner
def _write(w, k, S, D, S_row, D_row, with_tangent):
    """Write stress and moduli of point k into their rows."""
    for a in range(6):
        w[S_row + a, k] = S[a]
        if with_tangent:
            for b in range(6):
                w[D_row + 6 * a + b, k] = D[a, b]


@in_threads(by_colour)
def evaluate(
    begin: int,
    end: int,
    q: Reals,
    part: Part,
    places: Places,
    axes: Reals,
    scale: Reals,
    history: Reals,
    laws: TensorLawTable,
    fibres: FibreTable,
    activation: Reals,
    weight: Reals,
    with_tangent: bool,
    f: Reals,
    energy: Reals,
    least_J: Reals,
    values: Reals,
) -> None:
    """Subtract dE/dx from the nodal forces f and, if requested, add the stiffness to values.

    Row e of axes (row, 3, 3), scale (row,) and history (row, point, 6), or one without rows,
    belongs to element e of the part; all other arguments are those of
    `sim._kernels.solid.evaluate`.
    """
    points = part.slope.shape[0] // 3
    x = np.empty((NODES, 3))
    at = point_scratch()
    S, D, St, Dt = at.S, at.D, np.empty(6), np.empty((6, 6))
    w = rows(TENSOR_ROWS)
    clear(w, 0, TENSOR_ROWS)
    for e in range(part.chunk[begin], part.chunk[end]):
        own = part.element[e]
        energy[own] = 0.0
        if weight.size > 0 and weight[own] == 0.0:
            least_J[own] = math.inf
            continue
        all_J = deform(w, q, part, e, x)
        least_J[own] = least(all_J)
        if not (least_J[own] > 0.0):
            continue
        if with_tangent:
            fetch_matrix(places, e, values)
        dV = load(part.volume, e)
        if weight.size > 0:
            dV = weight[own] * dV
        row, factor = laws.region[own], scale[e]
        measure, kappa = laws.measure[row], laws.kappa[row]
        is_small = measure == SMALL_STRAIN
        rests = all_rest(w, all_J, own, fibres, activation)
        for k in range(points):
            J = _deformation_at(w, k, at.F, at.cof)
            strains(at, J)
            W = factor * passive_law(
                measure, laws.code[row], laws.p[row], J, axes[e], at, with_tangent
            )
            for a in range(6):
                S[a] *= factor
            if history.shape[0] > 0:
                W += _add_history(history[e, k], at.small if is_small else at.C, S)
            # St and Dt are derivatives by C; a law of small strain has separate S and D.
            share = 0.0 if is_small else 1.0
            for a in range(6):
                St[a] = share * S[a]
            if with_tangent:
                for a in range(6):
                    for b in range(6):
                        D[a, b] *= factor
                        Dt[a, b] = share * D[a, b]
            if kappa != 0.0:
                W += _add_bulk(laws.bulk_code[row], kappa, J, at.inverse, St, Dt, with_tangent)
            if not rests:
                at.Sb[:] = 0.0
                at.Db[:] = 0.0
                for fibre in range(fibres.start[own], fibres.start[own + 1]):
                    W += add_fibre(fibres, fibre, activation, J, at, with_tangent)
                project(at.Sb, at.Db, J, at.C, at.inverse, St, Dt, with_tangent, at.work)
            w[W_ROW, k] = W
            _write(w, k, St, Dt, S_ROW, D_ROW, with_tangent)
            if is_small:
                _write(w, k, S, D, SMALL_S_ROW, SMALL_D_ROW, with_tangent)
        energy[own] = total(dV * load(w, W_ROW))
        put(w, P_ROW, natural(first_stress(w, is_small), part.inverse, e))
        for r in range(P_ROW, P_ROW + 9):
            store(w, r, dV * load(w, r))
        nodal(w, P_ROW, part.slope, P_ROW)
        subtract_from_nodes(w, P_ROW, part.nodes, e, f)
        if with_tangent:
            clear(w, MODULI_ROW, 9 * BLOCKS)
            strain_rows(w, part.inverse, e, False)
            add_moduli(w, D_ROW, dV)
            add_geometric(w, part.inverse, e, dV)
            if is_small:
                strain_rows(w, part.inverse, e, True)
                add_moduli(w, SMALL_D_ROW, dV)
            stiffness_blocks(w, MODULI_ROW, part.slope, BLOCK_ROW)
            add_to_matrix(w, BLOCK_ROW, part.nodes, places, e, values)


@in_threads(by_chunk)
def law_stress(
    begin: int, end: int, q: Reals, part: Part, axes: Reals, laws: TensorLawTable, out: Reals
) -> None:
    """Stress S of the passive law only, out (row, point, 6) [Pa]; NaN if det F <= 0."""
    x = np.empty((NODES, 3))
    at, w = point_scratch(), rows(S_ROW)
    for e in range(part.chunk[begin], part.chunk[end]):
        deform(w, q, part, e, x)
        row = laws.region[part.element[e]]
        for k in range(out.shape[1]):
            J = _deformation_at(w, k, at.F, at.cof)
            if not (J > 0.0):
                out[e, k, :] = math.nan
                continue
            strains(at, J)
            passive_law(laws.measure[row], laws.code[row], laws.p[row], J, axes[e], at, False)
            out[e, k, :] = at.S
