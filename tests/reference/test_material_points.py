"""Stress and spatial moduli at material points against those of another simulator.

Provenance: ArtiSynth 3.9 (see the README of the data). Its moduli are the push-forward
D_ijkl = F_iI F_jJ F_kK F_lL D_IJKL / J of the material ones, in the component order of this
package.
"""

import json

import numba as nb
import numpy as np
import pytest

import sim
from sim._kernels import tensor_laws, tensor_point
from sim._kernels.laws import FibreTable
from sim._kernels.symmetric import COLUMN, PLACE, ROW
from sim._kernels.tensor_point import PointScratch
from sim.laws.fibre import N_FIBRE

project = nb.njit(lambda *arguments: tensor_point.project(*arguments))
add_fibre = nb.njit(lambda *arguments: tensor_point.add_fibre(*arguments))
tensor_law = nb.njit(lambda *arguments: tensor_laws.tensor_law(*arguments))

FIBRE_LAWS = {"blemker": sim.Blemker, "generic": sim.Generic}
WORK = np.empty((4, 6, 6))
ROUNDING = 1e-13
"""Relative; two double-precision programs, sums in different order."""


@pytest.fixture(scope="module")
def points(shared):
    path = shared / "artisynth_reference" / "unit" / "unit_material_points.json"
    return json.loads(path.read_text())


def six(A):
    return np.ascontiguousarray(A[ROW, COLUMN])


def pushed_forward(F, S, D):
    """Cauchy stress (3, 3) and spatial moduli (6, 6) [Pa]."""
    J = np.linalg.det(F)
    stress, moduli = np.empty((3, 3)), np.empty((3, 3, 3, 3))
    stress[...] = S[PLACE]
    moduli[...] = D[PLACE[:, :, None, None], PLACE[None, None]]
    spatial = np.einsum("iI,jJ,kK,lL,IJKL->ijkl", F, F, F, F, moduli) / J
    i, j = ROW[:, None], COLUMN[:, None]
    return F @ stress @ F.T / J, spatial[i, j, ROW, COLUMN]


def isochoric(F, add):
    """Stress and moduli of an isochoric law, from the function that adds its derivatives."""
    J, C = np.linalg.det(F), F.T @ F
    Sb, Db, S, D = (np.zeros(shape) for shape in (6, (6, 6), 6, (6, 6)))
    add(J, six(C), Sb, Db)
    project(Sb, Db, J, six(C), six(np.linalg.inv(C)), S, D, True, WORK)
    return pushed_forward(F, S, D)


def passive(F, law):
    form = sim.Material(law, relaxation=sim.Prony((0.5,), (1.0,))).tensor_form

    def add(J, C, Sb, Db):
        _, code, p = form
        tensor_law(code, np.array(p), J ** (-2 / 3) * C, np.eye(3), Sb, Db, True, WORK)

    return isochoric(F, add)


def fibre(F, law, activation, a0):
    p = np.zeros((1, N_FIBRE))
    p[0, : len(law.parameters())] = law.parameters()
    ends, first, code = np.array([0, 1]), np.zeros(1, dtype=np.int64), np.array([law.code])
    fibres = FibreTable(ends, first, a0[None], np.ones(1), code, p)

    def add(J, C, Sb, Db):
        at = PointScratch(F, F, C, C, C, Sb, Db, Sb, Db, C, WORK)
        add_fibre(fibres, 0, np.array([activation]), J, at, True)

    return isochoric(F, add)


def agree(computed, expected, scale):
    np.testing.assert_allclose(computed, expected, rtol=0, atol=ROUNDING * scale)


@pytest.mark.parametrize(
    "law", [sim.MooneyRivlin(2500.0, 1175.0), sim.FiveTermMooneyRivlin(2500.0, 0.0, 1175.0)]
)
def test_stress_and_moduli_of_the_passive_law(points, law):
    assert len(points["cases"]) > 3
    for case in points["cases"]:
        sigma, D = passive(np.array(case["F"]), law)
        expected = case["MR_dev"]
        agree(sigma, expected["sigma"], np.abs(expected["D"]).max())
        agree(D, expected["D"], np.abs(expected["D"]).max())


def test_stress_and_moduli_of_the_fibres(points):
    covered = set()
    for case in points["cases"]:
        for muscle in case["muscle"]:
            material, activation = muscle["material"], muscle["excitation"]
            name = material["type"].removesuffix("Muscle").lower()
            law = FIBRE_LAWS[name](sigma_max=material["maxStress"])
            sigma, D = fibre(np.array(case["F"]), law, activation, np.array(case["dir0"]))
            agree(sigma, muscle["sigma"], material["maxStress"])
            agree(D, muscle["D"], material["maxStress"])
            covered.add((name, activation))
    assert covered == {(name, a) for name in FIBRE_LAWS for a in (0.0, 0.5, 1.0)}


def test_fibre_laws_over_all_stretches(points):
    """Isochoric stretch along the fibre, over every branch of both laws."""
    covered = set()
    for point in points["stretch_sweep"]:
        stretch, law = point["lambda"], FIBRE_LAWS[point["type"]](sigma_max=1e5)
        F = np.diag([stretch, stretch**-0.5, stretch**-0.5])
        sigma, D = fibre(F, law, point["excitation"], np.array([1.0, 0.0, 0.0]))
        agree(sigma[0, 0], point["sigma_xx"], 1e5)
        agree(sigma[1, 1], point["sigma_yy"], 1e5)
        agree(D[0, 0], point["D_xxxx"], 1e6)
        covered.add((point["type"], stretch))
    for name in FIBRE_LAWS:
        stretches = [stretch for other, stretch in covered if other == name]
        assert min(stretches) < 0.4 and max(stretches) > 1.6
