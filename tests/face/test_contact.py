"""Contact of a face: pairings, terms of the scene, and closing of the lips."""

import numpy as np
import pytest
import xarray as xr

import emgface as ef
import sim
from emgface.choices import configure
from emgface.errors import ConfigurationError, FaceError
from emgface.face.contact import contact_pairings, touching
from emgface.face.lips import lip_surface
from emgface.face.parts import LIPS
from emgface.face.penetration import Penetration, depths
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from sim.contact.compiled import FORCE, FRICTION


@pytest.fixture(scope="module")
def face(coarse: xr.Dataset) -> xr.Dataset:
    return coarse


def test_lips_and_teeth_are_paired_as_asked(face: xr.Dataset) -> None:
    def paired(**more: object) -> list[str]:
        return [pairing.name for pairing in contact_pairings(face, **more)]

    lips, maxilla, mandible = paired()
    assert lips == "upper lip on lower lip"
    assert maxilla == "lining of the mouth on maxilla"
    assert mandible == "lining of the mouth on mandible"
    assert paired(between=("lips",)) == [lips]
    assert paired(between=("teeth",)) == [maxilla, mandible]
    for pairing in contact_pairings(face):
        pairing.check(compose_scene(face, SimulationParameters()).mesh)
    without = face.drop_dims(["arch_point", "arch_facet"])
    with pytest.raises(FaceError, match="the face has no teeth"):
        contact_pairings(without)


def test_contact_is_on_by_default_for_all_surfaces_of_the_face(face: xr.Dataset) -> None:
    """By default all surfaces of the face are in contact, without the teeth if walls represent them."""
    default = SimulationParameters()
    assert default.contact.method == "constraint" and default.solver == "sdirk2"
    assert touching(face, default) == ("lips", "teeth")
    assert touching(face.drop_dims(["arch_point", "arch_facet"]), default) == ("lips",)
    plain = face.drop_dims(["arch_point", "arch_facet"]).drop_vars("lip_opening_node")
    assert touching(plain, default) == ()
    assert touching(face, SimulationParameters(support=1000.0)) == ("lips",)
    asked = SimulationParameters.model_validate({"contact": {"between": ["lips", "teeth"]}})
    with pytest.raises(FaceError, match="expected dental arches: .* leave contact.between out"):
        compose_scene(plain.assign(lip_opening_node=face["lip_opening_node"]), asked)


def test_a_scene_has_contact_only_where_it_is_declared(face: xr.Dataset) -> None:
    def contacts(**values: object) -> list[object]:
        scene = compose_scene(face, SimulationParameters.model_validate(values))
        return [term for term in scene.terms if "Contact" in type(term).__name__]

    assert contacts(contact={"method": "none"}) == []
    (term,) = contacts(contact={"friction": 0.3, "renewals": 2})
    assert isinstance(term, sim.ConstraintContact)
    assert term.friction == 0.3 and term.renewals == 2


def test_renewed_normals_halve_the_error_of_closing_lips(face: xr.Dataset) -> None:
    """Relative to steps of 2.5 ms with renewals; the motion itself is above 4 mm."""
    time = np.linspace(0.0, 0.15, 16)
    level = np.outer(np.char.startswith(face["muscle"].values.astype(str), "OOP"), 4.0 * time)
    drive = xr.DataArray(
        level.clip(0.0, 0.4), dims=("muscle", "time"),
        coords={"muscle": face["muscle"], "time": ("time", time, {"units": "s"})},
        attrs={"units": "1", "origin": "simulated"},
    )  # fmt: skip

    def moved(step: float, renewals: int) -> xr.DataArray:
        chosen = {
            "step": step,
            "output": 0.01,
            "solver": "sdirk2",
            "contact": {"renewals": renewals},
        }
        return ef.simulate(drive, face, progress=False, **chosen)["position"]

    exact, without, renewed = moved(0.0025, 2), moved(0.01, 0), moved(0.01, 1)
    errors = [float(abs(one - exact).max()) for one in (without, renewed)]
    assert errors[1] < 0.6 * errors[0], errors
    assert float(abs(exact - exact[..., 0]).max()) > 4e-3


def test_lips_that_are_held_closed_do_not_oscillate(face: xr.Dataset) -> None:
    """Renewed rows have no filter of normals; rows at predicted positions move markers by 0.16 mm."""
    names = face["muscle"].values.astype(str)
    closing = np.char.startswith(names, "OOP") | np.char.startswith(names, "DAO")
    drive = xr.DataArray(
        np.outer(closing, [0.0, 0.7, 0.7]), dims=("muscle", "time"),
        coords={"muscle": face["muscle"], "time": ("time", [0.0, 0.1, 0.7], {"units": "s"})},
        attrs={"units": "1", "origin": "simulated"},
    )  # fmt: skip
    moved = ef.simulate(drive, face, progress=False, sigma_max=100e3, gravity=False)["position"]
    assert float(abs(moved - moved[..., 0]).max()) > 4e-3
    steps = np.diff(moved.transpose("time", ...).values[40:], axis=0)
    to_and_fro = np.minimum(*(np.maximum(sign * steps, 0.0).sum(axis=0) for sign in (1.0, -1.0)))
    assert to_and_fro.max() < 2e-5


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"contact": {"method": "glue"}}, "contact.method"),
        ({"contact": {"between": []}}, "expected 'lips', 'teeth' or both"),
        ({"contact": {"between": ["lips", "lips"]}}, "expected 'lips', 'teeth' or both"),
        ({"contact": {"friction": -0.1}}, "contact.friction"),
        ({"contact": {"method": "barrier"}}, "contact.method"),
        (
            {"contact": {"method": "constraint"}, "solver": "trapezoidal"},
            "or method = 'none'",
        ),
        ({"contact": {"between": ["teeth"]}, "support": 10.0}, "represents the teeth"),
        (
            {"contact": {"renewals": 1}, "accuracy": "published"},
            "contact.renewals = 1 has no effect",
        ),
        ({"contact": {"renewals": -1}}, "contact.renewals"),
    ],
)
def test_incompatible_settings_are_refused_with_a_reason(
    values: dict[str, object], message: str
) -> None:
    with pytest.raises(ConfigurationError, match=message):
        configure(SimulationParameters, values)


def test_depth_in_a_cube() -> None:
    mesh = sim.mesh_from_arrays(
        np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float),
        hex8=np.array([[0, 1, 3, 2, 4, 5, 7, 6]]),
    )
    corners = mesh.X[sim.boundary_surface(mesh).triangles]
    points = np.array([[0.5, 0.5, 0.9], [0.3, 0.5, 0.5], [0.5, 0.5, 1.1], [-0.2, 0.5, 0.5]])
    np.testing.assert_allclose(depths(points, corners), [0.1, 0.3, 0.0, 0.0], atol=1e-12)


def test_depth_of_a_face_starts_at_rest(face: xr.Dataset) -> None:
    """The template has no penetration at rest; moved back by 3 mm it penetrates the teeth by as much."""
    penetration, X = Penetration(face), face["position"].values
    assert penetration.at_rest() == {"maxilla": (0, 0.0), "mandible": (0, 0.0)}
    assert penetration.lips(X) == penetration.teeth(X) == 0.0
    assert 1e-3 < penetration.teeth(X - [0.0, 3e-3, 0.0]) < 3e-3
    patch = face.isel(arch_facet=slice(1, None))  # an open surface has no inside; it gave depths
    assert np.isnan(Penetration(patch).teeth(X - [0.0, 3e-3, 0.0]))
    lips = X.copy()
    lips[np.unique(lip_surface(face, LIPS[0])), 2] -= 6e-3
    assert 1e-3 < penetration.lips(lips) < 6e-3


def test_closing_lips_obey_the_law_of_friction(medium: xr.Dataset) -> None:
    """Lips of a medium face that close and slide on each other, with contacts that repeat each other.

    At the end of every step, friction is 0.2 of the normal force of its vertex.
    """
    parameters = {"contact": {"friction": 0.2}, "gravity": False, "sigma_max": 100e3}
    scene = compose_scene(medium, SimulationParameters.model_validate(parameters))
    system = sim.compile_scene(scene)
    peak = np.array([0.4 if name[:3] in ("OOP", "OOM") else 0.0 for name in system.muscles])
    drive = sim.Activation(np.array([0.0, 0.1]), np.stack([0.0 * peak, peak]))
    state, work = system.rest_state(), sim.Workspace(system)
    normal = friction = np.zeros(0)
    gap, steps = 0.0, sim.FixedStep(0.005)
    for _ in range(8):
        part, state = sim.simulate(
            system,
            drive,
            duration=0.005,
            integrator=sim.LinearlyImplicitEuler(),
            steps=steps,
            initial=state,
            probes=(sim.Contacts(),),
            work=work,
        )
        memory, gap = state.memory["contact"], float(part["contact_gap"].isel(time=-1).min())
        normal, friction = memory[:, FORCE], np.linalg.norm(memory[:, FRICTION], axis=1)
        assert (friction <= 0.2 * normal * (1.0 + 1e-9)).all()
    touches = normal > 1e-3 * normal.max()
    assert touches.sum() > 50 and gap > -3e-6  # the penetration that is corrected
    np.testing.assert_allclose(friction[touches], 0.2 * normal[touches], rtol=1e-9)
