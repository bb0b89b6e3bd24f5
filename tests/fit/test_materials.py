"""Laws from curves of a probe: known parameters with noise, intervals, and what is not identified."""

import numpy as np
import pandas as pd
import pytest

import sim
from emgface.errors import FitError
from emgface.fit.materials import Curve, fit_material, probe_curves_of
from emgface.fit.probing import Block, probe_forces

BLOCK = Block(elements=8)
DEPTHS = np.linspace(0.3e-3, 1.5e-3, 5)
SOFT = {"c10": 2500.0, "c20": 1175.0, "kappa": 25e3}


def _model(directions):
    def forces(p):
        material = sim.Material(
            sim.MooneyRivlin(p["c10"], p["c20"]), sim.QuadraticBulk(p.get("kappa", 25e3))
        )
        return probe_forces(
            BLOCK, material, dict.fromkeys(directions, DEPTHS), (p.get("prestress", 0.0), 0.0)
        )

    return forces


def _curves(truth, directions, noise, seed=1):
    rng = np.random.default_rng(seed)
    return {
        name: Curve(DEPTHS, force * (1.0 + noise * rng.standard_normal(len(force))))
        for name, force in _model(directions)(truth).items()
    }


def test_small_forces_approach_those_of_a_half_space():
    """Rigid circular probe on a half-space: 4 G a d / (1 - nu) inward, about 8 G a d / (2 - nu) along.

    The displacement method is stiffer, less so on a finer mesh.
    """
    G, K, a, d = 1000.0, 4000.0, 2e-3, 1e-5
    nu = (3.0 * K - 2.0 * G) / (2.0 * (3.0 * K + G))
    exact = {"inward": 4.0 * G * a * d / (1.0 - nu), "along": 8.0 * G * a * d / (2.0 - nu)}
    material = sim.Material(sim.NeoHooke(G), sim.QuadraticBulk(K))
    excess = []
    for elements in (8, 12, 16):
        block = Block(width=60e-3, depth=30e-3, elements=elements)
        forces = probe_forces(block, material, dict.fromkeys(exact, [d]))
        excess.append([forces[name][0] / exact[name] - 1.0 for name in exact])
    assert (np.diff(excess, axis=0) < 0.0).all() and (np.array(excess) > 0.0).all()
    assert max(excess[-1]) < 0.45, excess


def test_two_directions_identify_three_parameters():
    curves = _curves(SOFT, ("inward", "along"), 0.03)
    fit = fit_material(_model(curves), {"c10": 1000.0, "c20": 1000.0, "kappa": 1e5}, curves)
    assert fit.parameters["identified"].all() and "All parameters" in fit.statement
    assert 0.015 < fit.nrmse < 0.05
    for name, value in SOFT.items():
        low, high = fit.parameters.loc[name, ["lower", "upper"]]
        assert low * 0.8 < value < high * 1.25
    assert fit["c10"] == pytest.approx(2500.0, rel=0.1)


def test_one_indentation_does_not_identify_them():
    """Negative control: the curve is fitted as well, and the parameters remain unknown."""
    curves = _curves(SOFT, ("inward",), 0.03)
    fit = fit_material(_model(curves), {"c10": 1500.0, "c20": 1500.0, "kappa": 5e4}, curves)
    assert fit.nrmse < 0.05
    assert not fit.parameters.loc["kappa", "identified"]
    assert "do not identify" in fit.statement and "kappa" in fit.statement
    assert fit.condition > 100.0


def test_intervals_contain_the_truth_as_often_as_stated():
    """90 % of 40 repeats with Gaussian noise; a law with a closed form: uniaxial stretch of a strip."""
    stretch = np.linspace(1.05, 1.5, 12)

    def strip(p):
        i1 = stretch**2 + 2.0 / stretch - 3.0
        force = 2.0 * (stretch - stretch**-2) * (p["c10"] + 2.0 * p["c20"] * i1)
        return {"along": 1e-6 * force}

    truth = {"c10": 2500.0, "c20": 1175.0}
    clean, inside = strip(truth)["along"], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        force = clean + 0.03 * clean.max() * rng.standard_normal(len(clean))
        curves = {"along": Curve(1e-3 * (stretch - 1.0), force)}
        table = fit_material(strip, {"c10": 1000.0, "c20": 1000.0}, curves).parameters
        inside.append([table.loc[k, "lower"] < v < table.loc[k, "upper"] for k, v in truth.items()])
    covered = np.array(inside).mean()
    assert 0.82 <= covered <= 0.98, covered  # two standard deviations of 40 binomial repeats


def test_curves_that_cannot_be_used_are_refused():
    curves = _curves(SOFT, ("inward",), 0.0)
    good, model, start = curves["inward"], _model(curves), {"c10": 1000.0, "c20": 1000.0}
    for wrong, match in (
        ({}, "no curve"),
        ({"down": good}, "no direction 'down'"),
        ({"inward": Curve(DEPTHS, good.force[:-1])}, "shapes"),
        ({"inward": Curve(DEPTHS[::-1], good.force)}, "increasing"),
        ({"inward": Curve(1e3 * DEPTHS, good.force)}, "check the unit"),
        ({"inward": Curve(DEPTHS, -good.force)}, "check the sign"),
        ({"inward": Curve(DEPTHS, np.full(5, np.nan))}, "not finite"),
        ({"inward": Curve(DEPTHS[:2], good.force[:2])}, "2 forces are given for 2"),
    ):
        with pytest.raises(FitError, match=match):
            fit_material(model, start, wrong)
    with pytest.raises(FitError, match="start of c10"):
        fit_material(model, {"c10": -1.0}, curves)
    falling = {"inward": Curve(DEPTHS, good.force[-1] * np.array([3.0, 0.1, 3.0, 0.1, 3.0]))}
    with pytest.raises(FitError, match="rms force only"):
        fit_material(model, start, falling)
    table = pd.DataFrame(
        {"direction": ["inward"] * 5, "displacement_mm": 1e3 * DEPTHS, "force_mn": 1e3 * good.force}
    )
    assert probe_curves_of(table)["inward"].force == pytest.approx(good.force)
    with pytest.raises(FitError, match="no column force_mn"):
        probe_curves_of(table.drop(columns="force_mn"))
    with pytest.raises(FitError, match="no equilibrium"):
        probe_forces(
            BLOCK, sim.Material(sim.NeoHooke(1e3), sim.QuadraticBulk(1e3)), {"inward": [9e-3]}
        )
