"""Short descriptions of objects in a prompt or a notebook."""

import numpy as np
import xarray as xr

import sim
from analysis.cube import build_cube
from analysis.trial import Trial
from emgface.face.simulation_parameters import SimulationParameters
from emgface.schema.netcdf import write_netcdf
from emgface.study.run import StudyResult


def scene() -> sim.Scene:
    edges = np.linspace(0, 0.01, 2), np.linspace(0, 0.02, 2), np.linspace(0, 0.03, 3)
    mesh = sim.grid_mesh(np.stack(np.meshgrid(*edges, indexing="ij"), axis=-1))
    return sim.Scene(
        mesh,
        terms=(sim.Solid(), sim.Gravity()),
        reductions=(sim.Fixed(np.arange(4)), sim.Fixed(np.arange(2))),
        damping=sim.RestRayleigh(),
    )


def test_scene_and_system_count_what_they_hold():
    facts = scene().facts()
    assert facts["elements"] == "2 hex8" and facts["size"] == "10 x 20 x 30 mm"
    assert facts["terms"] == "Solid, Gravity"
    assert facts["fixed"] == "12 of 36 unknowns", "nodes fixed twice count once"
    system = sim.compile_scene(scene())
    assert system.facts()["mass"] == "6.24 g", "1040 kg/m3 times 6 cm3"
    assert system.facts()["unknowns"].startswith("24,")
    for shown in (repr(scene()), repr(system), repr(scene().mesh)):
        assert shown.startswith("<sim.") and len(shown) < 400


def test_a_scene_of_bodies_alone_is_described():
    ball = sim.Body("ball", 0.25, 1e-4 * np.eye(3))
    assert repr(sim.NO_TISSUE) == "<sim.Mesh>\n  nodes  0"
    assert sim.Scene(sim.NO_TISSUE, (), bodies=(ball,)).facts()["bodies"] == "ball"
    assert (
        sim.compile_scene(sim.Scene(sim.NO_TISSUE, (), bodies=(ball,))).facts()["mass"] == "250 g"
    )


def test_html_escapes_and_lists_the_same_facts():
    class Odd(sim.Scene):
        def facts(self):
            return {"a < b": "1 & 2"}

    made = scene()
    shown = Odd(made.mesh, made.terms)._repr_html_()
    assert "a &lt; b" in shown and "1 &amp; 2" in shown
    assert all(fact in made._repr_html_() for fact in made.facts().values())


def test_parameters_show_what_differs_from_the_defaults():
    shown = repr(SimulationParameters(sigma_max=1e5))
    assert shown == "SimulationParameters(sigma_max=100000.0)"
    table = SimulationParameters(sigma_max=1e5)._repr_html_()
    assert "sigma_max" in table and "kappa" in table and "Pa" in table


def test_study_result_shows_design_status_and_median(tmp_path):
    scores = xr.Dataset(
        {name: ("marker", [0.5, 0.7, 0.9]) for name in ("rho", "amplitude_ratio", "rmse")},
        coords={"marker": ["a", "b", "c"]},
    )
    scores["reason"] = "marker", ["", "", ""]
    trials = [
        Trial("V1", "A", 1, "act_all", scores, origin="simulated"),
        Trial("V1", "A", 2, "act_all", status="missing", reason="none"),
    ]
    cube = build_cube(
        trials, volunteers=["V1"], instructions=["A"], repetitions=[1, 2],
        strategies=["act_all"], markers=["a", "b", "c"], origin="simulated",
    )  # fmt: skip
    path = write_netcdf(cube, tmp_path / "cube.nc", "cube")
    result = StudyResult(path, tmp_path / "journal.jsonl", [], [])
    facts = result.facts()
    assert facts["recordings"] == "simulated" and "2 repetition" in facts["design"]
    assert facts["trials"] == "1 missing, 1 ok"
    assert facts["median rho"] == "act_all 0.70"
    assert "act_all 0.70" in result._repr_html_()
