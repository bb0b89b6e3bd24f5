"""Every registered law: slope and curvature are the derivatives of its energy."""

import re
from dataclasses import fields, replace

import numba as nb
import numpy as np
import pytest

from sim._kernels import laws as kernel
from sim._kernels.lanes import load, store
from sim._kernels.lines import LineTable, tensions
from sim.laws import (
    BULK_LAWS,
    FIBRE_LAWS,
    ISOCHORIC_LAWS,
    LINE_LAWS,
    TENSOR_LAWS,
    ForceVelocity,
    Hill,
    slopes,
)
from sim.laws.parameters import units

NONE = np.zeros(1)
isochoric = nb.njit(lambda code, p, I1bar: kernel.isochoric(code, p, I1bar))
bulk = nb.njit(lambda code, kappa, J: kernel.bulk(code, kappa, J))
fibre = nb.njit(lambda code, p, stretch, drive: kernel.fibre(code, p, stretch, drive))


@nb.njit
def of_lanes(code, p, x, drive):
    """Energy, slope and curvature (3, n, 8) of a fibre law at rows of eight stretches."""
    out = np.empty((3, *x.shape))
    for i in range(len(x)):
        values = kernel.fibre(code, p, load(x, i), drive)
        store(out[0], i, values[0])
        store(out[1], i, values[1])
        store(out[2], i, values[2])
    return out


@nb.njit
def bulk_of_lanes(code, kappa, x):
    """The same of a bulk law at rows of eight volume ratios."""
    out = np.empty((3, *x.shape))
    for i in range(len(x)):
        modulus = kernel.bulk(code, kappa, load(x, i))
        store(out[0], i, modulus[0])
        store(out[1], i, modulus[1])
        store(out[2], i, modulus[2])
    return out


def derivatives_agree(function, x, h=1e-5):
    """Central differences of w and w' against w' and w''."""
    w, w1, w2 = function(x)
    below, above = function(x - h), function(x + h)
    scale = max(abs(w1), abs(w2), 1e-3)
    assert (above[0] - below[0]) / (2 * h) == pytest.approx(w1, abs=1e-6 * scale)
    assert (above[1] - below[1]) / (2 * h) == pytest.approx(w2, abs=1e-6 * scale)


def equal_forms(of_class, of_kernel):
    """The array form of the class against the kernel, both with two derivatives."""
    scale = max(np.abs(of_kernel).max(), 1.0)
    np.testing.assert_allclose([float(x) for x in of_class], of_kernel, rtol=0, atol=1e-12 * scale)


def parameters(law, n):
    p = np.zeros(n)
    p[: len(law.parameters())] = law.parameters()
    return p


@pytest.mark.parametrize("cls", ISOCHORIC_LAWS)
@pytest.mark.parametrize("I1bar", [3.0, 3.2, 5.0, 9.0])
def test_isochoric(cls, I1bar):
    law = cls()
    equal_forms(law.evaluate(np.array(I1bar)), isochoric(law.code, parameters(law, 2), I1bar))
    derivatives_agree(lambda x: isochoric(law.code, parameters(law, 2), x), I1bar)
    assert isochoric(law.code, parameters(law, 2), 3.0)[0] == 0.0


@pytest.mark.parametrize("cls", BULK_LAWS)
@pytest.mark.parametrize("J", [0.2, 0.8, 1.0, 1.3, 2.5])
def test_bulk(cls, J):
    law = cls()
    equal_forms(law.evaluate(np.array(J)), bulk(law.code, law.kappa, J))
    derivatives_agree(lambda x: bulk(law.code, law.kappa, x), J)
    w, w1, w2 = bulk(law.code, law.kappa, 1.0)
    assert (w, w1, w2) == (0.0, 0.0, law.kappa)


@pytest.mark.parametrize("cls", FIBRE_LAWS)
@pytest.mark.parametrize("activation", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("stretch", [0.3, 0.5, 0.7, 0.95, 1.05, 1.3, 1.5, 1.7])
def test_fibre(cls, activation, stretch):
    law = cls()
    p = parameters(law, 5)
    if "P1" in cls.__annotations__:
        if cls.__name__ == "Generic":
            law = replace(law, P1=0.05 * law.sigma_max)  # not negligible
        p = parameters(law, 5)
    here = law.evaluate(np.array(stretch), np.array(activation))
    equal_forms(here, fibre(law.code, p, stretch, activation))
    derivatives_agree(lambda x: fibre(law.code, p, x, activation), stretch)


@pytest.mark.parametrize("law", [*FIBRE_LAWS, BULK_LAWS[1]], ids=lambda law: law.__name__)
@pytest.mark.parametrize("activation", [0.0, 0.4])
def test_eight_points_at_once_have_the_values_of_each(law, activation):
    """On both sides of every place at which branches meet, and slopes alone."""
    own = law()
    ends = [0.4, 0.6, 1.0, 1.4, 1.6]
    near = [end + side for end in ends for side in (-0.03, -1e-12, 0.0, 1e-12, 0.03)]
    for x in (near, [0.7, 0.99], [1.1, 1.3], [0.2, 2.5]):
        x = np.resize(np.array(x), 8 * -(-len(x) // 8))
        if law in FIBRE_LAWS:
            p = parameters(own, 5)
            one = np.array([fibre(own.code, p, stretch, activation) for stretch in x])
            lanes = of_lanes(own.code, p, x.reshape(-1, 8), activation)
            of_class = own.evaluate(x, np.full_like(x, activation))[1]
            np.testing.assert_allclose(
                slopes(own, x, np.full_like(x, activation)), one[:, 1], rtol=1e-14, atol=1e-20
            )
            np.testing.assert_allclose(of_class, one[:, 1], rtol=1e-11, atol=1e-9 * own.sigma_max)
        else:
            one = np.array([bulk(own.code, own.kappa, J) for J in x])
            lanes = bulk_of_lanes(own.code, own.kappa, x.reshape(-1, 8))
        size = np.abs(one).max(axis=0)
        np.testing.assert_allclose(lanes.reshape(3, -1).T, one, rtol=1e-12, atol=1e-12 * size.max())


@pytest.mark.parametrize("cls", FIBRE_LAWS)
@pytest.mark.parametrize("kink", [0.4, 0.6, 1.0, 1.4, 1.6])
def test_energy_and_force_are_continuous_where_branches_meet(cls, kink):
    law = cls()
    below, above = (
        fibre(law.code, parameters(law, 5), kink + side, 0.7) for side in (-1e-12, 1e-12)
    )
    assert below[0] == pytest.approx(above[0], abs=1e-6)
    assert below[1] == pytest.approx(above[1], abs=1e-4)


def test_an_unknown_code_gives_nan():
    assert np.isnan(isochoric(99, np.zeros(2), 3.1)).all()
    assert np.isnan(bulk(99, 1.0, 1.1)).all()
    assert np.isnan(fibre(99, np.zeros(5), 1.1, 0.5)).all()


def lines():
    """Every line law, and the special cases of the law with a tendon."""
    laws = [cls(force_max=3.0, passive_fraction=0.2) for cls in LINE_LAWS]
    hill = laws[-1]
    return [*laws, replace(hill, pennation=0.4), replace(hill, tendon_strain=0.0)]


@pytest.mark.parametrize("law", lines(), ids=lambda law: type(law).__name__)
@pytest.mark.parametrize("activation", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("stretch", [0.4, 0.7, 0.97, 1.2, 1.45, 1.7])
def test_line(law, activation, stretch):
    """In units of a rest length of 1 m; away from the kinks of the passive curve."""

    def at(length):
        one = np.array([length]), np.ones(1), np.array([activation])
        return tuple(float(x[0]) for x in law.evaluate(*one))

    derivatives_agree(at, stretch)
    assert law.has_slope or at(stretch)[2] == 0.0
    one = np.zeros(1, dtype=np.int64)
    table = LineTable(
        one,
        np.full(1, 2.0),
        np.ones(1),
        one + law.code,
        parameters(law, 6)[None],
        0 * NONE,
        NONE,
        np.zeros((1, 3)),
    )
    F, slope = np.empty(1), np.empty(1)
    energy = tensions(table, np.array([stretch]), np.array([activation]), F, slope)
    np.testing.assert_allclose(
        [energy, F[0], slope[0]], 2.0 * np.array(at(stretch)), rtol=1e-11, atol=1e-15
    )


def test_hill_has_the_force_of_its_definition():
    """Isometric force at the optimal length, and equal tension of pennate fibres and their tendon."""
    one = np.ones(1)
    rigid = Hill(5.0, pennation=0.3, tendon_strain=0.0)
    assert rigid.evaluate(one, one, one)[1][0] == pytest.approx(5.0 * np.cos(0.3), rel=1e-12)
    elastic = Hill(5.0, tendon_ratio=0.4, pennation=0.3, tendon_strain=0.05)
    F = elastic.evaluate(one, one, one)[1][0]
    y = 1.0 - 0.4 * (
        1.0 + 0.05 * F / 5.0
    )  # length of the fibres in series with the stretched tendon
    l_opt = 0.6 / np.cos(0.3)
    length = np.hypot(y, l_opt * np.sin(0.3))
    active = np.exp(-((length / l_opt - 1.0) ** 2) / 0.45)
    assert F == pytest.approx(5.0 * active * y / length, rel=1e-12)


@pytest.mark.parametrize(
    "cls", (*ISOCHORIC_LAWS, *BULK_LAWS, *FIBRE_LAWS, *LINE_LAWS, *TENSOR_LAWS, ForceVelocity)
)
def test_every_parameter_of_a_law_has_a_unit(cls):
    """Moduli, which a stiffness multiplies, are the parameters whose unit is the pascal."""
    assert set(units(cls)) == {field.name for field in fields(cls)}
    assert set(units(cls).values()) <= {"Pa", "1", "N", "1/s", "rad"}


def test_a_scalar_law_is_in_three_files_at_most(root):
    """The kernel with its dispatcher, the class with its register, and the exported name."""
    for cls in (*ISOCHORIC_LAWS, *BULK_LAWS):
        kernel_name = re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower()
        names = {
            str(path.relative_to(root))
            for package in ("sim", "emgface")
            for path in (root / package).rglob("*.py")
            if re.search(rf"\b(class {cls.__name__}|def {kernel_name})\b", path.read_text("utf-8"))
        }
        assert len(names) == 2, names
