"""Simulated gestures of the six instructions compared with published descriptions."""

import numpy as np
import pytest
import xarray as xr

from emgface.errors import DataError
from emgface.face.contact_parameters import NO_CONTACT
from emgface.face.lip_shape import lip_opening, lip_rim, lip_shape
from emgface.face.muscle_parameters import SIGMA_MAX
from emgface.face.penetration import Penetration
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.support import WALL
from emgface.face.template.actions import muscle_actions, steady_positions
from emgface.face.template.gestures import GESTURES, gesture_activation
from emgface.muscles import INSTRUCTIONS, LIP_MARKERS, RELEVANT


def test_gestures_use_the_relevant_muscles() -> None:
    assert list(GESTURES) == list(INSTRUCTIONS)
    for instruction, (_, left, right) in GESTURES.items():
        assert {*left, *right} <= set(RELEVANT[instruction])
    assert gesture_activation("B") == {"LLSAN_L": 0.5, "LLSAN_R": 0.5}
    aside = gesture_activation("E")
    assert aside["ZYG_L"] > 0 and "ZYG_R" not in aside
    with pytest.raises(DataError, match="unknown instruction 'G', expected one of"):
        gesture_activation("G")


@pytest.fixture(scope="module")
def positions(coarse: xr.Dataset) -> dict[str, np.ndarray]:
    """With contact of lips and teeth; ramps of 0.3 s are held to 0.5 s."""
    parameters = SimulationParameters(sigma_max=SIGMA_MAX, gravity=False)
    return gesture_positions(coarse, "ADF", parameters)


def gesture_positions(
    face: xr.Dataset, which: str, parameters: SimulationParameters
) -> dict[str, np.ndarray]:
    runs = [gesture_activation(instruction) for instruction in which]
    equilibria, smallest = steady_positions(
        face, runs, parameters=parameters, duration=0.5, step=0.1
    )
    assert smallest.min() > 0.1
    return dict(zip(which, equilibria, strict=True))


class Mouth:
    """Measures of a mouth in mm, of one face and its rest."""

    def __init__(self, face: xr.Dataset) -> None:
        self.rest, self.marker = face["position"].values, face["marker_node"].values
        self.margin = face["lip_opening_node"].values
        self.face = face

    def moved(self, q: np.ndarray, marker: str) -> np.ndarray:
        node = self.marker[LIP_MARKERS.index(marker)]
        return 1e3 * (q[node] - self.rest[node])

    def opening(self, q: np.ndarray) -> float:
        return 1e3 * lip_opening(self.face, q)

    def widening(self, q: np.ndarray) -> float:
        """Relative change of the distance between the corners of the opening."""
        rim = lip_rim(self.face)
        width, rest = (lip_shape(self.face, rim, p)["width"] for p in (q, self.rest))
        return width / rest - 1.0

    def upper_margin(self, q: np.ndarray) -> float:
        return 1e3 * float(q[self.margin[0], 2] - self.rest[self.margin[0], 2])


def test_lips_stay_out_of_each_other_and_of_the_teeth(
    coarse: xr.Dataset, positions: dict[str, np.ndarray]
) -> None:
    penetration = Penetration(coarse)
    for name, q in positions.items():
        assert penetration.lips(q) < 1e-4 and penetration.teeth(q) < 1e-4, name


def test_a_smile_looks_like_a_smile(coarse: xr.Dataset, positions: dict[str, np.ndarray]) -> None:
    """In spontaneous smiles of 15 children the corners move up and laterally at about 47 degrees and
    the mouth widens by 27 % (Tarantili et al. 2005, Am J Orthod Dentofacial Orthop 128:8-15); the
    corners of a published model move by 11 to 14 mm in its expressions (Flynn et al. 2015, Comput
    Methods Biomech Biomed Eng 18:571-582), those of Eskes et al. 2017 (Results) less than those of
    their volunteers. The voluntary smile opens the mouth and shows the teeth, the other one keeps it
    closed (the same section); neither lowers the upper lip.
    """
    mouth = Mouth(coarse)
    for smile in "DF":
        q = positions[smile]
        side, _, up = mouth.moved(q, "corner_left")
        assert 5.5 < np.linalg.norm(mouth.moved(q, "corner_left")) < 14.0
        assert 40.0 < np.degrees(np.arctan2(up, -side)) < 56.0
        assert 0.12 < mouth.widening(q) < 0.35
        assert mouth.upper_margin(q) > 0.5, "the upper lip does not descend"
        for marker in ("upper_paramedian_left", "upper_lateral_left"):
            assert mouth.moved(q, marker)[2] > 0.5
    assert mouth.opening(positions["D"]) > 5.0 > mouth.opening(mouth.rest)
    assert -0.1 < mouth.opening(positions["F"]) < 1.0
    # The corner has the largest displacement (Stavness et al., Facial expression simulations).
    size = {m: np.linalg.norm(mouth.moved(positions["D"], m)) for m in LIP_MARKERS}
    assert max(size, key=lambda name: size[name]).startswith("corner")


def test_a_purse_looks_like_a_purse(coarse: xr.Dataset, positions: dict[str, np.ndarray]) -> None:
    """With the relevant muscles it has no opening (Eskes et al. 2017, Results), a narrower mouth and
    protruded lips (Stavness et al., sections on lip protrusion).
    """
    mouth, purse = Mouth(coarse), positions["A"]
    assert -0.1 < mouth.opening(purse) < 1.0
    for side, sign in (("left", 1.0), ("right", -1.0)):
        corner = mouth.moved(purse, f"corner_{side}")
        assert sign * corner[0] > 3.0 and corner[1] > 3.0
    for lip in ("upper", "lower"):
        assert mouth.moved(purse, f"{lip}_paramedian_left")[1] > 2.0


def test_the_other_gestures_move_as_instructed(coarse: xr.Dataset) -> None:
    """With walls instead of teeth, which is faster."""
    parameters = SimulationParameters(
        sigma_max=SIGMA_MAX, gravity=False, support=WALL, contact=NO_CONTACT
    )
    mouth, positions = Mouth(coarse), gesture_positions(coarse, "BCE", parameters)
    raised = positions["B"]
    assert mouth.moved(raised, "upper_paramedian_left")[2] > 2.0
    assert abs(mouth.moved(raised, "lower_paramedian_left")[2]) < 1.0
    assert mouth.moved(positions["C"], "corner_left")[2] < -2.0
    for marker in LIP_MARKERS:
        assert mouth.moved(positions["E"], marker)[0] < 0.0, "the whole mouth goes to the left"


def test_zygomaticus_alone_hardly_closes_the_mouth(coarse: xr.Dataset) -> None:
    """Lips supported by teeth stretch over them; without teeth the mouth closed by 5.9 mm."""
    actions = muscle_actions(coarse, muscles=("ZYG",)).loc["ZYG"]
    closed = 1e3 * lip_opening(coarse, coarse["position"].values) - float(actions["opening"])
    assert 0.0 < closed < 2.5
    assert float(actions["upper_paramedian z"]) > -1.0
    assert float(actions["corner x"]) < -2.0 and float(actions["corner z"]) > 1.5
