"""Floor of the mouth: muscles that are tissue of the tongue and lines of the jaw at the same time."""

import numpy as np
import pytest
import xarray as xr

import sim
from emgface.anatomy.head.build import build_head, floor_force
from emgface.anatomy.head.model import Head
from emgface.anatomy.head.run import raised, simulate_head
from emgface.anatomy.head.scene import TONGUE, head_scene
from emgface.anatomy.jaw.template import template_jaw
from emgface.anatomy.tongue.scene import tongue_scene
from emgface.anatomy.tongue.template.build import person
from emgface.anatomy.tongue.template.muscles import GENIAL

LINES = {"GH": ("gh",), "MH": ("am", "pm")}


@pytest.fixture(scope="module")
def head() -> Head:
    return build_head(["jaw", "tongue", "hyoid"], preset="man", tongue_resolution=150, contacts=[])


def _line_force(jaw: xr.Dataset, lines: tuple[str, ...], side: str) -> float:
    own = np.isin(jaw["muscle"].values, [f"{line}{side}" for line in lines])
    return float(jaw["muscle_force_max"].values[own].sum())


@pytest.mark.parametrize("side", ["_L", "_R"])
@pytest.mark.parametrize("muscle", LINES)
def test_force_of_tissue_and_lines_is_that_of_the_jaw(head: Head, muscle: str, side: str) -> None:
    """Tissue and lines pull with the largest force of the same muscle of a jaw without a tongue."""
    whole = _line_force(template_jaw(preset="man"), LINES[muscle], side)
    lines = _line_force(head.parts["jaw"], LINES[muscle], side)
    tissue = floor_force(head.parts["tongue"], muscle + side)
    assert 1.0 < tissue < whole and lines > 1.0
    assert tissue + lines == pytest.approx(whole, rel=1e-12)


def test_force_of_the_tissue_is_its_work_over_its_length(head: Head) -> None:
    """Nodal forces of the active geniohyoid do the work F l e in an isochoric shortening by e."""
    tongue = head.parts["tongue"]
    system = sim.compile_scene(tongue_scene(tongue, TONGUE))
    names = list(system.muscles)
    own = tongue["fibre_muscle"].values == list(tongue["muscle"].values).index("GH_L")
    ends = [
        tongue["fibre_position"].values[tongue["fibre_of_point"].values == k][[0, -1]]
        for k in np.flatnonzero(own)
    ]
    along = np.mean([b - a for a, b in ends], axis=0)
    length = np.linalg.norm(along)
    along /= length
    q = system.rest_state().q
    active = np.zeros(len(names))
    active[names.index("GH_L")] = 1.0
    f = [system.tangent(q, system.control(a))[0].f for a in (active, 0.0 * active)]
    strain = 1.5 * np.outer(along, along) - 0.5 * np.eye(3)  # keeps the volume
    work = -float(((f[0] - f[1]) * (q @ strain)).sum())
    force = floor_force(tongue, "GH_L")
    # the elements of a coarse mesh are inclined to the mean fibre by up to 20 degrees
    assert 0.8 * force < work / length < 1.02 * force


def test_tissue_is_held_near_the_tubercles_and_no_element_is_crushed_there() -> None:
    """Nodes in the midline on the bone are at most 7 mm above the origin of genioglossus.

    All muscles at 1.0, 300 kPa, steps of 20 ms: with tissue held 10 mm above it, the smallest det F
    was 0.118, and 0.004 in a head with a face.
    """
    head = build_head(["jaw", "tongue", "hyoid"], preset="man", contacts=[])
    tongue, attached = head.parts["tongue"], head.attached("tongue-jaw")
    places, _ = person(None, "man", None)
    genial = places[GENIAL[0]] + 1e-3 * np.array(GENIAL[1:])
    X = tongue["position"].values[attached]
    assert 0.0 < (X[np.abs(X[:, 0]) < 1e-6, 2] - genial[2]).max() < 7e-3
    scene = head_scene(head, tongue=TONGUE.model_copy(update={"sigma_max": 300e3}))
    drive = {f"bi_{str(m)[:-2]}": 1.0 for m in tongue["muscle"].values}
    motion = simulate_head(
        head, raised(drive | {"bi_close": 0.02}, rise=0.1), duration=0.16, step=2e-2, scene=scene
    )
    assert float(motion["smallest_J"].min()) > 0.15


def test_exciters_reach_tissue_and_lines(head: Head) -> None:
    """Both names of a muscle, and every group that contains it, excite its tissue and its lines."""
    names = [str(m) for m in head.lists["muscle"].values]
    gain = {
        str(e): {names[k] for k in np.flatnonzero(g)}
        for e, g in zip(
            head.lists["exciter"].values, head.lists["exciter_gain"].values, strict=True
        )
    }
    assert set(np.unique(head.lists["exciter_gain"].values)) == {0.0, 1.0}
    geniohyoid, mylohyoid = {"GH_L", "gh_L"}, {"MH_L", "am_L", "pm_L"}
    for name in ("GH_L", "gh_L"):
        assert gain[name] == geniohyoid
    for name in ("MH_L", "my_L"):
        assert gain[name] == mylohyoid
    for name in ("open_L", "suprahyoid_L", "protracthyoid_L", "bi_open"):
        assert geniohyoid | mylohyoid <= gain[name]
    assert gain["bi_GH"] == {"GH_L", "gh_L", "GH_R", "gh_R"}


def test_jaw_without_a_tongue_keeps_its_muscles_and_exciters() -> None:
    """A head without a tongue has the muscles, forces and exciters of the jaw, bit for bit."""
    whole = template_jaw(preset="man")
    head = build_head(["jaw", "hyoid"], preset="man")
    xr.testing.assert_identical(head.parts["jaw"], whole)
    np.testing.assert_array_equal(head.lists["exciter"].values, whole["exciter"].values)
    np.testing.assert_array_equal(head.lists["exciter_gain"].values, whole["exciter_gain"].values)
