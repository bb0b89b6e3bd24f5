"""Tissues of layers, muscles and elements, from the study file to the scene."""

import tomllib

import numpy as np
import pytest
import xarray as xr

import sim
from emgface.choices import configure
from emgface.errors import ConfigurationError, FaceError
from emgface.face.motion import settle_face, simulate_face
from emgface.face.parts import OUTER
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.tissue import TISSUE_LAWS, Tissue, material_axes
from emgface.muscles import MUSCLES
from emgface.report.methods import methods
from emgface.study.configuration import StudyConfiguration
from emgface.study.file import study_template
from sim import compile_scene
from sim.laws import ISOCHORIC_LAWS, TENSOR_LAWS

FLYNN = """
gravity = false
bulk_potential = "quadratic"
kappa = 50e3

[[tissues]]
coefficients = { C10 = 400.0, C20 = 1400.0 }

[[tissues]]
layers = ["outer"]
law = "fung"
stiffness = 0.5
kappa = 250e3
density = 1100.0
"""
"""Layers of the published face with anisotropic skin; the young skin."""


def parameters(text: str) -> SimulationParameters:
    return configure(SimulationParameters, tomllib.loads(text))


def solid_of(face: xr.Dataset, p: SimulationParameters) -> sim.Solid:
    return compose_scene(face, p).terms[0]


def test_every_law_of_passive_tissue_has_a_name_in_the_study_file() -> None:
    assert set(TISSUE_LAWS.values()) == {*ISOCHORIC_LAWS, *TENSOR_LAWS}
    for name, law in TISSUE_LAWS.items():
        assert Tissue(law=name).passive_law() == law()


def test_layers_of_the_published_face_with_anisotropic_skin(slab) -> None:
    solid = solid_of(slab, parameters(FLYNN))
    outer = (
        slab["layer"].values == OUTER
    )  # all hexahedra: the order of the face is that of the scene
    materials = [solid.materials[i] for i in solid.region]
    deep = sim.Material(sim.MooneyRivlin(400.0, 1400.0), sim.QuadraticBulk(50e3))
    fung = sim.Fung((8886.5, 2965.5, 2965.5), (500.0,) * 6, 1892.0)
    assert {materials[i] for i in np.flatnonzero(~outer)} == {deep}
    assert {materials[i] for i in np.flatnonzero(outer)} == {
        sim.Material(fung, sim.QuadraticBulk(250e3), 1100.0)
    }
    assert outer.any() and not outer.all()
    axes = solid.axes
    np.testing.assert_allclose(axes.transpose(0, 2, 1) @ axes, np.tile(np.eye(3), (len(axes), 1, 1)),
                               atol=1e-12)  # fmt: skip
    # The normal of the skin of a slab is y.
    np.testing.assert_allclose(np.abs(material_axes(slab)[outer][:, 1, 2]), 1.0, atol=0.2)


def test_skin_of_fung_is_stiffest_along_its_tension_line(slab) -> None:
    """Energy of the skin under a small isochoric stretch along axis 1 and 2 of one element."""
    p = parameters(
        "P1 = 0.0\n" + FLYNN
    )  # without passive fibres, which are perpendicular to those lines
    solid, system = solid_of(slab, p), compile_scene(compose_scene(slab, p))
    e = int(np.flatnonzero(slab["layer"].values == OUTER)[0])
    energy = []
    for axis in (0, 1):
        a = solid.axes[e][:, axis]
        F = 1.02**-0.5 * np.eye(3) + (1.02 - 1.02**-0.5) * np.outer(a, a)
        control = system.control(np.zeros(len(MUSCLES)))
        system.force(slab["position"].values @ F.T, control)
        energy.append(system.terms[0]._energy[e])
    assert energy[0] > 1.5 * energy[1] > 0.0


def test_conditions_are_combined_and_later_tissues_have_priority(slab) -> None:
    ids = slab["element_id"].values
    p = SimulationParameters(
        tissues=(
            {"muscles": ("OOP_L", "OOP_R"), "coefficients": {"C10": 7000.0}},
            {"layers": ("centre", "outer"), "muscles": ("OOP_L",), "law": "neo_hooke"},
            {"elements": (int(ids[3]), int(ids[5])), "law": "ogden"},
        )
    )
    solid = solid_of(slab, p)
    laws = [type(solid.materials[i].law) for i in solid.region]
    muscle = slab["muscle"].values[slab["bundle_muscle"].values]
    elements = {m: set(slab["bundle_index"].values[muscle == m]) for m in ("OOP_L", "OOP_R")}
    deep = set(np.flatnonzero(slab["layer"].values == 0))
    for e, law in enumerate(laws):
        expected = sim.MooneyRivlin
        if e in elements["OOP_L"] - deep:
            expected = sim.NeoHooke
        if e in (3, 5):
            expected = sim.Ogden
        assert law is expected, e
    stiff = {e for e in range(len(laws)) if solid.materials[solid.region[e]].law
             == sim.MooneyRivlin(7000.0, 1175.0)}  # fmt: skip
    assert stiff == (elements["OOP_L"] & deep | elements["OOP_R"] - (elements["OOP_L"] - deep)) - {
        3,
        5,
    }


def test_a_face_without_tissues_is_unchanged(slab) -> None:
    solid = solid_of(slab, SimulationParameters())
    assert len(solid.materials) == 1 and solid.region is None and solid.axes is None


@pytest.mark.parametrize(
    ("kind", "term"), [("element", sim.ElementVolume), ("nodal", sim.NodalVolume)]
)
def test_the_volume_of_every_layer_keeps_its_own_modulus(slab, kind, term) -> None:
    p = parameters(f'incompressibility = "{kind}"\n' + FLYNN)
    scene = compose_scene(slab, p)
    outer = slab["layer"].values == OUTER
    volume = next(t for t in scene.terms if isinstance(t, term))
    np.testing.assert_array_equal(volume.kappa, np.where(outer, 250e3, 50e3))
    assert {m.kappa for m in scene.terms[0].materials} == {0.0}
    system = compile_scene(scene)
    at_rest = system.force(scene.mesh.X, system.control(np.zeros(len(MUSCLES))))
    assert np.abs(at_rest.f).max() < 1e-12 and at_rest.energy == pytest.approx(0.0, abs=1e-15)


def drive(slab, duration=0.2) -> xr.DataArray:
    time = np.linspace(0.0, duration, 21)
    values = np.zeros((len(MUSCLES), time.size))
    values[MUSCLES.index("LLSAN_L")] = 0.6 * np.minimum(time / 0.05, 1.0)
    return xr.DataArray(
        values, coords={"muscle": list(MUSCLES), "time": time}, dims=("muscle", "time")
    )


def largest_motion(slab, **more) -> float:
    p = SimulationParameters(**{"sigma_max": 50e3, "gravity": False} | more)
    motion = simulate_face(slab, drive(slab), p)
    return float(np.abs(motion["position"] - motion["position"].isel(time=0)).max())


def test_a_stiffer_skin_moves_landmarks_less(slab) -> None:
    moved = [
        largest_motion(slab, tissues=({"layers": ("outer",), "stiffness": factor},))
        for factor in (1.0, 4.0, 16.0)
    ]
    assert moved[0] > 1.1 * moved[1] > 1.1**2 * moved[2] > 0.0


def test_relaxing_tissue_moves_more_than_elastic_and_less_than_relaxed_tissue(slab) -> None:
    slow = {"relaxing": (0.5,), "times": (0.1,)}
    elastic, relaxing, relaxed = (
        largest_motion(slab, tissues=(tissue,)) for tissue in ({}, slow, {"stiffness": 0.5})
    )
    assert elastic < relaxing < relaxed
    p = SimulationParameters(tissues=(slow,))
    assert float(settle_face(slab, p)["node_position"].isnull().sum()) == 0


def test_tissues_of_a_study_file_are_written_and_read_back() -> None:
    study = StudyConfiguration(simulation=parameters(FLYNN))
    values = tomllib.loads(study_template(study))
    assert configure(StudyConfiguration, values).simulation == study.simulation
    assert "[[simulation.tissues]]" in study_template()  # as a comment
    assert tomllib.loads(study_template())["simulation"].get("tissues", []) == []


def test_the_methods_of_a_report_state_every_tissue() -> None:
    slow = parameters(FLYNN + "relaxing = [0.3, 0.2]\ntimes = [0.2, 1.5]\n")
    dims = ("volunteer", "instruction", "repetition")
    cube = xr.Dataset({"status": (dims, [[["ok"]]])}, attrs={"origin": "simulated"})
    text = methods(StudyConfiguration(simulation=slow), cube)
    assert "The tissue of the whole face had law MooneyRivlin(C10=400.0, C20=1400.0)" in text
    assert (
        "The tissue of the outer layer had law Fung(mu=(8886.5, 2965.5, 2965.5), lame=(500.0, 500.0, "
        "500.0, 500.0, 500.0, 500.0), c=1892.0) (stresses in Pa), kappa 250 kPa, density 1100 kg/m³, "
        "relaxation of 30 % with 0.2 s and 20 % with 1.5 s."
    ) in text


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[[tissues]]\nlaw = "rubber"', "tissues.0.law"),
        ('[[tissues]]\ncoefficients = {C30 = 1.0}', "coefficient C30 of law 'mooney_rivlin'"),
        ('[[tissues]]\ncoefficients = {C10 = -1.0}', "C10 = -1.0"),
        ('[[tissues]]\nlaw = "ogden"\ncoefficients = {mu = 3.0}', "tissues.0"),
        ('[[tissues]]\nmuscles = ["OOP"]', "muscle OOP is unknown"),
        ('[[tissues]]\nrelaxing = [0.6, 0.5]\ntimes = [1.0, 2.0]', "1 - sum of g"),
        ('[[tissues]]\nrelaxing = [0.6]', "1 fractions g for 0"),
        ('[[tissues]]\nlaw = "co_rotational"\nkappa = 1e5', "determines the volume change itself"),
        (
            'incompressibility = "nodal"\nbulk_potential = "quadratic"\n[[tissues]]\nlaw = "linear"',
            "'linear' or 'co_rotational' cannot be combined with .* 'nodal'",
        ),
        ("stiffening = 3.0\n[[tissues]]\nrelaxing = [0.6]\ntimes = [1.0]", "cannot stiffen"),
    ],
)  # fmt: skip
def test_invalid_tissues_are_refused(text, said) -> None:
    with pytest.raises(ConfigurationError, match=said):
        parameters(text)


@pytest.mark.parametrize(
    ("tissue", "said"),
    [
        ({"elements": (10**6,)}, "lists element 1000000"),
        (
            {"elements": (1,), "layers": ("outer",), "muscles": ("MEN_L",)},
            "no element is in layers",
        ),
    ],
)
def test_tissues_that_the_face_does_not_have_are_refused(slab, tissue, said) -> None:
    with pytest.raises(FaceError, match=said):
        compose_scene(slab, SimulationParameters(tissues=(tissue,)))
