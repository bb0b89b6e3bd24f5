"""Simulated motions by the muscles of the template."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from emgface.errors import ActivationError
from emgface.face.contact_parameters import NO_CONTACT
from emgface.face.lip_shape import lip_opening
from emgface.face.motion import simulate_face
from emgface.face.penetration import Penetration
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template import template_face
from emgface.face.template.actions import (
    ACTIONS,
    moves_as_described,
    muscle_actions,
    steady_positions,
)
from emgface.face.template.grid import make_grid, refined_grid
from emgface.muscles import LIP_MARKERS, MODELLED
from sim import ConstraintContact, ConvergedEuler, Positions

FREE = SimulationParameters(sigma_max=100e3, gravity=False, contact=NO_CONTACT)
MIRROR = np.array([-1.0, 1.0, 1.0])


def test_every_muscle_has_an_action_with_source() -> None:
    assert set(ACTIONS) == set(MODELLED)
    for action in ACTIONS.values():
        assert action.source and action.signs
        for marker, axis, sign in action.signs:
            assert marker in LIP_MARKERS and marker.endswith("left")
            assert axis in "xyz" and sign in (-1, 1)


@pytest.mark.parametrize("muscle", MODELLED)
def test_each_criterion_of_an_action_is_required(coarse: xr.Dataset, muscle: str) -> None:
    """Displacements of 1 mm as described, of which one is reversed or zero."""
    rest, action = coarse["position"].values, ACTIONS[muscle]
    node = dict(zip(coarse["marker"].values.tolist(), coarse["marker_node"].values, strict=True))
    moves = [(node[marker], "xyz".index(axis), sign) for marker, axis, sign in action.signs]
    if action.closes:
        upper, lower = coarse["lip_opening_node"].values
        moves += [(upper, 2, -1), (lower, 2, 1)]

    def described(factors: list[float]) -> bool:
        q = rest.copy()
        for factor, (place, axis, sign) in zip(factors, moves, strict=True):
            q[place, axis] += 1e-3 * factor * sign
        return moves_as_described(coarse, muscle, q)

    assert described([1.0] * len(moves))
    for factor in (-1.0, 0.0, 0.05):
        assert not described([factor] * len(moves))
        for k in range(len(moves)):
            assert not described([factor if i == k else 1.0 for i in range(len(moves))])


def test_lips_that_are_half_open_are_not_closed(coarse: xr.Dataset) -> None:
    q, node = coarse["position"].values.copy(), coarse["marker_node"].values
    upper, lower = coarse["lip_opening_node"].values
    q[node[LIP_MARKERS.index("corner_left")], 0] += 1e-3
    gap = q[upper, 2] - q[lower, 2]
    for share, closed in ((0.2, False), (0.3, True)):
        moved = q.copy()
        moved[upper, 2] -= share * gap
        moved[lower, 2] += share * gap
        assert moves_as_described(coarse, "OOM", moved) is closed


def test_a_face_without_activation_shows_no_action(coarse: xr.Dataset) -> None:
    """With contact of lips and teeth, which must not move the face by itself."""
    parameters = SimulationParameters(sigma_max=100e3, gravity=False)
    (q,), _ = steady_positions(coarse, [{}], parameters=parameters, duration=0.2, step=0.1)
    assert np.abs(q - coarse["position"].values).max() < 1e-9
    assert not any(moves_as_described(coarse, muscle, q) for muscle in MODELLED)


def check_actions(face: xr.Dataset, muscles: tuple[str, ...] = MODELLED) -> None:
    table = muscle_actions(face, muscles=muscles)
    assert table["agrees"].all(), table.loc[~table["agrees"]].T
    assert (table["smallest det F"] > 0.1).all()
    # The motion is several millimetres, as in a face.
    size = {
        "ZYG": ("corner z", 1.0),
        "RIS": ("corner x", -1.0),
        "LLSAN": ("upper_paramedian z", 1.0),
        "LAO": ("corner z", 1.0),
        "BUC": ("corner y", -1.0),
        "OOP": ("corner x", 1.0),
        "OOM": ("corner x", 1.0),
        "DLI": ("lower_paramedian z", -1.0),
        "DAO": ("corner z", -1.0),
        "MEN": ("lower_paramedian z", 1.0),
    }
    for muscle in muscles:
        column, sign = size[muscle]
        assert sign * table.loc[muscle, column] > 1.0, (muscle, column)


def test_an_action_is_not_found_if_the_lips_pass_through_each_other(coarse: xr.Dataset) -> None:
    """OOM closes the lips; without contact they pass through each other."""
    through = muscle_actions(coarse, muscles=("OOM",), parameters=FREE).loc["OOM"]
    upper, lower = coarse["position"].values[coarse["lip_opening_node"].values]
    assert upper[2] - lower[2] > 2e-3
    assert through["opening"] < -1.0
    assert through["lips in lips"] > 1.0
    assert not through["agrees"]
    fixed = muscle_actions(coarse, muscles=("OOM",)).loc["OOM"]
    assert fixed["opening"] > -0.1
    assert fixed["lips in lips"] < 0.01
    assert fixed["agrees"]


def test_the_opening_of_a_trajectory_is_negative_where_lips_have_passed(coarse: xr.Dataset) -> None:
    """A strong purse without contact, compared with the positions of the same run."""
    parameters = SimulationParameters(
        sigma_max=300e3, gravity=False, accuracy="draft", contact=NO_CONTACT
    )
    muscles = [str(name) for name in coarse["muscle"].values]
    peak = np.array([1.0 if name.startswith("OOP") else 0.0 for name in muscles])
    activation = xr.DataArray(
        np.stack([0.0 * peak, peak], axis=1),
        dims=("muscle", "time"),
        coords={"muscle": muscles, "time": [0.0, 0.08]},
    )
    motion = simulate_face(coarse, activation, parameters, further=(Positions(),))
    q = 1e3 * motion["node_position"].transpose("time", "node", "axis").values
    upper, lower = coarse["lip_opening_node"].values
    opening = 1e3 * motion["lip_opening"].values
    np.testing.assert_allclose(opening, q[:, upper, 2] - q[:, lower, 2], atol=1e-9)
    assert opening[0] > 2.0 and opening[-1] < -2.0
    assert np.abs(np.diff(opening)).max() < 3.0  # it passes zero without a jump
    assert 1e3 * Penetration(coarse).lips(1e-3 * q[-1]) > 2.0


def test_some_muscles_act_as_in_the_atlas(coarse: xr.Dataset) -> None:
    check_actions(coarse, ("ZYG", "LLSAN", "OOP", "DAO"))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["coarse", "medium"])
def test_all_muscles_act_as_in_the_atlas(name: str, request: pytest.FixtureRequest) -> None:
    check_actions(request.getfixturevalue(name))


@pytest.mark.slow
def test_the_motion_converges_with_the_mesh() -> None:
    """Grids refined by 1, 2, 3: an error proportional to h decreases monotonically."""
    smile = {"ZYG_L": 0.3, "ZYG_R": 0.3}
    moved: list[np.ndarray] = []
    for k in (1, 2, 3):
        face = template_face(resolution=refined_grid(k))
        (position,), _ = steady_positions(face, [smile], parameters=FREE, duration=0.6, step=0.1)
        moved.append((position - face["position"].values)[face["marker_node"].values])
    coarse, medium = (np.sqrt(((u - moved[2]) ** 2).sum(axis=1).mean()) for u in moved[:2])
    assert coarse > 3.0 * medium
    assert medium < 0.05 * np.sqrt((moved[2] ** 2).sum(axis=1).mean())


def test_a_mirrored_activation_gives_the_mirrored_motion(coarse: xr.Dataset, monkeypatch) -> None:
    """A smile to the left is the mirror image of one to the right, to a nanometre.

    The lips close on each other and on the teeth. Contact leaves gaps of 0.1 um instead of 1 um: what is
    left of them depends on the rounding of a processor, which mirrored the motion to 27 nm on one.
    """

    def finer(*given: Any) -> Any:
        scene = compose_scene(*given)
        contact = [t for t in scene.terms if isinstance(t, ConstraintContact)]
        assert len(contact) == 1
        others = tuple(t for t in scene.terms if t is not contact[0])
        return replace(scene, terms=(*others, replace(contact[0], tolerance=2e-4)))

    monkeypatch.setattr("emgface.face.template.actions.compose_scene", finer)
    left = {"ZYG_L": 0.5, "RIS_L": 0.3, "OOP_R": 0.2, "DAO_R": 0.4, "OOM_L": 0.5, "OOM_R": 0.5}
    other = {"L": "R", "R": "L"}
    right = {name[:-1] + other[name[-1]]: value for name, value in left.items()}
    (one, two), _ = steady_positions(
        coarse,
        [left, right],
        parameters=SimulationParameters(sigma_max=100e3, gravity=False),
        rise=0.15,
        duration=0.15,
        integrator=ConvergedEuler(tolerance=1e-12, residual_tolerance=1e-9),
    )
    opening = lip_opening(coarse, coarse["position"].values)
    assert lip_opening(coarse, one) < 0.5 * opening
    moved = np.linalg.norm(one - coarse["position"].values, axis=1)
    assert moved.max() > 2e-3
    image = make_grid("coarse").mirror_node
    np.testing.assert_allclose(one[image] * MIRROR, two, rtol=0, atol=1e-9)
    assert np.abs(one[image] * MIRROR - one).max() > 1e-3


def test_unknown_muscle(coarse: xr.Dataset) -> None:
    with pytest.raises(ActivationError, match="unknown muscle 'ZYG', expected some of ZYG_L"):
        steady_positions(coarse, [{"ZYG": 0.5}])
