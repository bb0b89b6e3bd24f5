"""Muscles of the template: courses, elements, rings, symmetry."""

import numpy as np
import pytest
import xarray as xr

from emgface.errors import FaceError
from emgface.face.bundles import project_into_mesh
from emgface.face.check import face_report, sheet_nodes
from emgface.face.parts import OUTER, elements_of, fibres_of
from emgface.face.quality import element_centres
from emgface.face.template import Measures, muscles, template_face
from emgface.face.template.calibrate import calibrated_surfaces
from emgface.face.template.courses import MODIOLUS, courses
from emgface.face.template.grid import make_grid
from emgface.face.template.muscles import RING_MUSCLES, Ring, parse_ring
from emgface.face.template.outline import PERIORAL, VERMILION
from emgface.muscles import MODELLED, SIDES

MIRROR = np.array([-1.0, 1.0, 1.0])
RAYS = [muscle for muscle in MODELLED if muscle not in RING_MUSCLES]


def test_both_sides_mirror_bit_by_bit(medium: xr.Dataset) -> None:
    grid = make_grid("medium")
    owner, direction = medium["bundle_muscle"].values, medium["bundle_direction"].values
    for k, muscle in enumerate(MODELLED):
        left, right = (elements_of(medium, f"{muscle}_{side}") for side in SIDES)
        np.testing.assert_array_equal(grid.mirror_element[left], right)
        np.testing.assert_array_equal(direction[owner == k] * MIRROR, direction[owner == k + 10])
        pairs = zip(fibres_of(medium, f"{muscle}_L"), fibres_of(medium, f"{muscle}_R"), strict=True)
        for one, other in pairs:
            np.testing.assert_array_equal(one * MIRROR, other)
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1.0, rtol=1e-12)


def test_no_muscle_in_the_skin(fine: xr.Dataset) -> None:
    assert (fine["layer"].values[fine["bundle_index"].values] != OUTER).all()


@pytest.mark.parametrize("muscle", RAYS)
def test_origins_are_deep_and_bony_insertions_near_the_mouth(fine: xr.Dataset, muscle: str) -> None:
    """The nearest node of the inner sheet is fixed to bone, except for the fascia of risorius."""
    position, fixed = fine["position"].values, fine["fixed"].values
    inner = sheet_nodes(fine, 0)
    for fibre in fibres_of(fine, f"{muscle}_L"):
        assert (fibre[:, 0] < 0).all()
        nearest = inner[np.argmin(np.linalg.norm(position[inner] - fibre[0], axis=1))]
        bone = {"DLI": 1, "DAO": 1, "MEN": 1}.get(muscle, 2)
        if muscle not in ("RIS", "BUC"):
            assert fixed[nearest] == bone
        mouth = np.array([-0.5 * fine.attrs["measure_mouth_width"], fibre[-1, 1], 0.0])
        if muscle in ("ZYG", "RIS", "LAO", "BUC", "DAO"):
            assert np.linalg.norm(fibre[-1] - mouth) < MODIOLUS + 3e-3


def test_courses_run_as_in_the_atlas(medium: xr.Dataset) -> None:
    """Direction from insertion to origin, on the left."""
    expected = {
        # lateral (-x), back (-y), up (+z): sign, or 0 if not stated in the atlas.
        "ZYG": (-1, -1, 1),
        "RIS": (-1, -1, 0),
        "LLSAN": (0, 0, 1),
        "LAO": (0, 0, 1),
        "BUC": (-1, -1, 0),
        "DLI": (-1, 0, -1),
        "DAO": (0, 0, -1),
        "MEN": (0, -1, 1),
    }
    for muscle, signs in expected.items():
        for fibre in fibres_of(medium, f"{muscle}_L"):
            run = fibre[0] - fibre[-1]
            for axis, sign in enumerate(signs):
                if sign:
                    assert sign * run[axis] > 1e-3, (muscle, axis)
    # Risorius is the most horizontal, zygomaticus oblique.
    slope = {m: fibres_of(medium, f"{m}_L")[0] for m in ("ZYG", "RIS")}
    rise = {m: (f[0] - f[-1])[2] / np.linalg.norm(f[0] - f[-1]) for m, f in slope.items()}
    assert rise["ZYG"] > 0.5 > rise["RIS"]


def test_lengths_are_those_of_muscles(medium: xr.Dataset) -> None:
    """Between 1 and 7 cm; zygomaticus longer than mentalis."""
    length = {
        muscle: max(
            np.linalg.norm(np.diff(fibre, axis=0), axis=1).sum()
            for fibre in fibres_of(medium, f"{muscle}_L")
        )
        for muscle in MODELLED
    }
    assert all(0.010 < value < 0.11 for value in length.values()), length
    assert length["ZYG"] > 0.045 > 0.025 > length["MEN"]


def test_fibres_lie_within_the_tissue(medium: xr.Dataset) -> None:
    """Points of fibres are outside the mesh by at most the error of its chords."""
    points = medium["fibre_position"].values
    left = points[points[:, 0] < 0]
    projected, _ = project_into_mesh(left, medium["position"].values, medium["connectivity"].values)
    assert np.linalg.norm(projected - left, axis=1).max() < 0.5e-3


@pytest.mark.parametrize("name", ["coarse", "medium", "fine"])
def test_every_muscle_is_one_piece_of_comparable_size(
    name: str, request: pytest.FixtureRequest, fine: xr.Dataset
) -> None:
    face = request.getfixturevalue(name)
    volume, reference = (face_report(f).muscles["volume"] for f in (face, fine))
    factor = {"coarse": 1.15, "medium": 1.05, "fine": 1.0}[name]
    assert (volume < factor * reference + 1e-6).all()
    assert (volume > reference / factor - 1e-6).all()
    connectivity = face["connectivity"].values
    for muscle in MODELLED:
        element = elements_of(face, f"{muscle}_L")
        group = np.arange(len(element))
        sets = [set(connectivity[e]) for e in element]
        for _ in range(len(element)):
            before = group.copy()
            for one in sets:
                near = [j for j, other in enumerate(sets) if one & other]
                group[near] = group[near].min()
            if (group == before).all():
                break
        assert (group == 0).all(), muscle


def test_rings_are_whole_rings(fine: xr.Dataset) -> None:
    """Elements of a part include every ray of its rings; the marginal part is superficial."""
    grid = make_grid("fine")
    ray, ring = grid.element_place
    marginal = grid.rings[0]
    peripheral = range(marginal + grid.rings[1] // 3, marginal + grid.rings[1])
    for muscle, rings in (("OOM", range(marginal)), ("OOP", peripheral)):
        element = np.concatenate([elements_of(fine, f"{muscle}_{side}") for side in SIDES])
        layers = {"OOM": {1}, "OOP": {0, 1}}[muscle]
        assert len(np.unique(element)) == len(element) == len(layers) * grid.rays * len(rings)
        assert set(ring[element]) == set(rings) and set(grid.layer[element]) == layers
        assert len(set(ray[element])) == grid.rays
    assert RING_MUSCLES["OOM"].inner == 0.0 and RING_MUSCLES["OOM"].outer == VERMILION
    assert RING_MUSCLES["OOP"].outer == PERIORAL


@pytest.mark.parametrize(
    ("words", "layers", "rings", "rays"),
    [
        ("marginal superficial", {2}, {0}, 24),
        ("peripheral deep middle gaps=0.2", {0, 1}, {2, 3}, 20),
        ("peripheral intermediate deep", {0}, {1, 2, 3}, 24),
    ],
)
def test_rings_of_another_depth_place_or_with_gaps(
    words: str, layers: set[int], rings: set[int], rays: int
) -> None:
    """The elements named by words, mirrored exactly, with fibres inside them."""
    face = template_face(resolution="coarse", rings={"OOP": parse_ring(words)})
    grid = make_grid("coarse")
    ray, ring = grid.element_place
    left, right = (elements_of(face, f"OOP_{side}") for side in "LR")
    assert set(grid.mirror_element[left]) == set(right)
    both = np.concatenate([left, right])
    assert set(grid.layer[both]) == layers and set(ring[both]) == rings
    assert len(both) == len(layers) * len(rings) * rays
    assert len(set(ray[both])) == rays  # gaps of 0.2 remove the two rays at each corner
    named = face["muscle"].values[face["fibre_muscle"].values]
    assert (named == "OOP_L").sum() == (2 if "gaps" in words else 1)


def test_impossible_rings_are_refused() -> None:
    for words in (
        "marginal",
        "deep",
        "marginal peripheral deep",
        "round deep",
        "marginal deep gaps=2",
    ):
        with pytest.raises(FaceError, match="expected"):
            parse_ring(words)
    narrow = Ring(0.0, 1e-3, (0,), 0.5)
    with pytest.raises(FaceError, match="contains no element"):
        template_face(resolution="coarse", rings={"OOM": narrow})


def test_ring_directions_follow_the_ring(fine: xr.Dataset) -> None:
    """Tangential to the loop of centres of the same ring, by central differences."""
    grid = make_grid("fine")
    centres = element_centres(fine["position"].values, fine["connectivity"].values)
    loops = centres.reshape(3, grid.rays, grid.n_rings, 3)
    tangent = (np.roll(loops, -1, axis=1) - np.roll(loops, 1, axis=1)).reshape(-1, 3)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    owner = fine["muscle"].values[fine["bundle_muscle"].values]
    rows = np.isin(owner, ["OOP_L", "OOP_R"])
    along = fine["bundle_direction"].values[rows]
    match = np.abs(np.einsum("ij,ij->i", along, tangent[fine["bundle_index"].values[rows]]))
    assert np.quantile(match, 0.02) > 0.97 and match.min() > 0.85


def test_the_chart_inverts_the_surface() -> None:
    """Inverse of the chart: a point at the position of a node is this node."""
    surfaces = calibrated_surfaces(Measures())
    q, lip, s = np.array([0.0, 0.3, 0.9, 0.55]), np.array([1, -1, 1, -1.0]), [0.2, 0.5, 0.9, 0.99]
    own = np.arange(4)
    place = surfaces.places(q, lip, np.array(s))[own, own]
    skin, inner = (sheet[own, own] * MIRROR for sheet in surfaces.sheets(q, lip, np.array(s)))
    np.testing.assert_allclose(surfaces.points(place, np.ones(4)), skin, atol=2e-8)
    np.testing.assert_allclose(surfaces.points(place, np.zeros(4)), inner, atol=2e-8)


def test_a_point_outside_the_tissue_is_refused() -> None:
    surfaces = calibrated_surfaces(Measures())
    with pytest.raises(FaceError, match=r"point 2 of 2, 0.0 mm from .* 200.0 mm above .* outside"):
        surfaces.points(np.array([[0.0, 0.03], [0.0, 0.2]]), np.ones(2))


def test_a_muscle_outside_the_tissue_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def strayed(m: Measures, corner: float) -> dict[str, tuple[muscles.Course, ...]]:
        lines = courses(m, corner)
        (first, *rest), *others = lines["ZYG"]
        return {**lines, "ZYG": (((0.3, first[1], 0.1), *rest), *others)}

    monkeypatch.setattr(muscles, "courses", strayed)
    with pytest.raises(FaceError, match="ZYG: the point 1 of 4, 300.0 mm from the midline"):
        template_face(resolution="coarse")


def test_radius(coarse: xr.Dataset) -> None:
    wide = template_face(resolution="coarse", radius=8e-3)
    for muscle in RAYS:
        assert set(elements_of(coarse, f"{muscle}_L")) <= set(elements_of(wide, f"{muscle}_L"))
    assert wide.attrs["muscle_radius"] == 8e-3
    with pytest.raises(FaceError, match="the muscle radius is 0.0 m"):
        template_face(resolution="coarse", radius=0.0)
