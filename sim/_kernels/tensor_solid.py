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
from sim._kernels.laws import bulk
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
    ROWS,
    S_ROW,
    SMALL_D_ROW,
    SMALL_S_ROW,
    W_ROW,
    add_geometric,
    add_moduli,
    all_rest,
    deform,
    first_stress,
    strain_rows,
)
from sim._kernels.tensor_laws import SMALL
from sim._kernels.tensor_point import add_fibre, add_product, passive_law, project, strains


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
    region: Indices,
    measure: Indices,
    law_code: Indices,
    law_p: Reals,
    bulk_code: Indices,
    kappa: Reals,
    fibre_start: Indices,
    fibre_muscle: Indices,
    fibre_direction: Reals,
    fibre_weight: Reals,
    muscle_code: Indices,
    muscle_p: Reals,
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
    F, cof = np.empty((3, 3)), np.empty((3, 3))
    C, inverse, small = np.empty(6), np.empty(6), np.empty(6)
    S, Sb, Cb = np.empty(6), np.empty(6), np.empty(6)
    D, Db = np.empty((6, 6)), np.empty((6, 6))
    St, Dt = np.empty(6), np.empty((6, 6))
    work = np.empty((4, 6, 6))
    w = rows(ROWS)
    clear(w, 0, ROWS)
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
        row, first, last = region[own], fibre_start[own], fibre_start[own + 1]
        is_small, factor = measure[row] == SMALL, scale[e]
        rests = all_rest(
            w,
            all_J,
            first,
            last,
            fibre_muscle,
            fibre_direction,
            muscle_code,
            muscle_p,
            activation,
        )
        for k in range(points):
            J = _deformation_at(w, k, F, cof)
            strains(F, J, cof, C, inverse, small)
            W = factor * passive_law(
                measure[row],
                law_code[row],
                law_p[row],
                J,
                C,
                inverse,
                small,
                axes[e],
                S,
                D,
                Sb,
                Db,
                Cb,
                with_tangent,
                work,
            )
            for a in range(6):
                S[a] *= factor
            if history.shape[0] > 0:
                W += _add_history(history[e, k], small if is_small else C, S)
            # St and Dt are derivatives by C; a law of small strain has separate S and D.
            share = 0.0 if is_small else 1.0
            for a in range(6):
                St[a] = share * S[a]
            if with_tangent:
                for a in range(6):
                    for b in range(6):
                        D[a, b] *= factor
                        Dt[a, b] = share * D[a, b]
            if kappa[row] != 0.0:
                W += _add_bulk(bulk_code[row], kappa[row], J, inverse, St, Dt, with_tangent)
            if not rests:
                Sb[:] = 0.0
                Db[:] = 0.0
                for fibre in range(first, last):
                    muscle = fibre_muscle[fibre]
                    W += add_fibre(
                        muscle_code[muscle],
                        muscle_p[muscle],
                        activation[muscle],
                        fibre_weight[fibre],
                        fibre_direction[fibre],
                        J,
                        C,
                        Sb,
                        Db,
                        with_tangent,
                    )
                project(Sb, Db, J, C, inverse, St, Dt, with_tangent, work)
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
    begin: int,
    end: int,
    q: Reals,
    part: Part,
    axes: Reals,
    region: Indices,
    measure: Indices,
    law_code: Indices,
    law_p: Reals,
    out: Reals,
) -> None:
    """Stress S of the passive law only, out (row, point, 6) [Pa]; NaN if det F <= 0."""
    x = np.empty((NODES, 3))
    F, cof = np.empty((3, 3)), np.empty((3, 3))
    C, inverse, small = np.empty(6), np.empty(6), np.empty(6)
    S, Sb, Cb = np.empty(6), np.empty(6), np.empty(6)
    D, Db = np.empty((6, 6)), np.empty((6, 6))
    work = np.empty((4, 6, 6))
    w = rows(S_ROW)
    for e in range(part.chunk[begin], part.chunk[end]):
        deform(w, q, part, e, x)
        row = region[part.element[e]]
        for k in range(out.shape[1]):
            J = _deformation_at(w, k, F, cof)
            if not (J > 0.0):
                out[e, k, :] = math.nan
                continue
            strains(F, J, cof, C, inverse, small)
            passive_law(
                measure[row],
                law_code[row],
                law_p[row],
                J,
                C,
                inverse,
                small,
                axes[e],
                S,
                D,
                Sb,
                Db,
                Cb,
                False,
                work,
            )
            out[e, k, :] = S
