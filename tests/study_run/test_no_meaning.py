"""Changes of a recording that mean nothing change neither its activation nor its scores.

A trial is the sEMG of a smile and the markers of another simulated motion of the face, seen by cameras.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

import emgface as ef
from tests.study.recordings import recording_of

pytestmark = pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")

QUICK = {"accuracy": "draft", "contact": {"method": "none"}}
CLOCKS = ("time_emg", "time_marker")


def mirrored(name: str) -> str:
    """Name of the same muscle, channel or marker on the other side."""
    if name[-2:] in ("_L", "_R"):
        return name[:-1] + {"L": "R", "R": "L"}[name[-1]]
    return name.replace("left", "#").replace("right", "left").replace("#", "right")


def renamed(data: xr.Dataset, **dims: str) -> xr.Dataset:
    for dim in dims:
        data = data.assign_coords({dim: [mirrored(str(name)) for name in data[dim].values]})
    return data


@dataclass(frozen=True)
class Trial:
    recording: xr.Dataset
    face: xr.Dataset

    def activation(self) -> xr.Dataset:
        return ef.activate(self.recording, strategy="act_rel", instruction="D")

    def motion(self) -> xr.Dataset:
        return ef.simulate(self.activation(), self.face, **QUICK)

    def scores(self, motion: xr.Dataset) -> xr.Dataset:
        return ef.score(self.recording, motion, face=self.face)


@pytest.fixture(scope="module")
def trial() -> Trial:
    face = ef.face(resolution="coarse")
    recording = recording_of(3, duration=0.8, instruction="D")
    drive = {"ZYG_L": 0.5, "ZYG_R": 0.35, "RIS_L": 0.2, "OOP_R": 0.1}
    seen = ef.simulate(drive, face, duration=0.8, **QUICK)
    skull = face["face_marker_position"].values[:, :, None].repeat(seen.sizes["time"], axis=2)
    lips = seen["position"].transpose("marker", "axis", "time").values
    places = np.concatenate([skull, lips])
    turn = Rotation.from_euler("xyz", [10, -5, 20], degrees=True).as_matrix()
    noise = 2e-5 * np.random.default_rng(5).standard_normal(places.shape)
    places = np.einsum("ij,mjt->mit", turn, places) + np.array([[[0.1], [2.0], [1.2]]]) + noise
    names = [*face["face_marker"].values, *seen["marker"].values]
    position = xr.DataArray(
        places,
        {"marker": names, "axis": list("xyz"),
         "time_marker": ("time_marker", seen["time"].values, {"units": "s"})},
        ("marker", "axis", "time_marker"), attrs={"units": "m"},
    )  # fmt: skip
    return Trial(recording.assign(position=position), face)


@pytest.fixture(scope="module")
def reference(trial: Trial) -> tuple[xr.Dataset, xr.Dataset, xr.Dataset]:
    motion = trial.motion()
    return trial.activation(), motion, trial.scores(motion)


def turned(recording: xr.Dataset) -> xr.Dataset:
    matrix = Rotation.from_euler("zyx", [130, 40, -70], degrees=True).as_matrix()
    place = recording["position"]
    moved = np.einsum("ij,mjt->mit", matrix, place.values) + np.array([[[3.0], [-2.0], [5.0]]])
    return recording.assign(position=place.copy(data=moved))


def later(recording: xr.Dataset) -> xr.Dataset:
    clocks = {c: (c, recording[c].values + 1234.5, {"units": "s"}) for c in CLOCKS}
    return recording.assign_coords(clocks)


def reordered(recording: xr.Dataset) -> xr.Dataset:
    rng = np.random.default_rng(2)
    return recording.isel({d: rng.permutation(recording.sizes[d]) for d in ("channel", "marker")})


def inverted(recording: xr.Dataset) -> xr.Dataset:
    return recording.assign(emg=-recording["emg"].assign_attrs(units="V")).assign(
        emg=lambda d: d["emg"].assign_attrs(units="V")
    )


def offset(recording: xr.Dataset) -> xr.Dataset:
    return recording.assign(
        emg=recording["emg"].copy(
            data=recording["emg"].values + np.linspace(-5e-3, 5e-3, 14)[:, None]
        )
    )


def more(recording: xr.Dataset) -> xr.Dataset:
    emg, place = recording["emg"], recording["position"]
    hand = emg.isel(channel=[0]).assign_coords(channel=["hand"])
    wand = place.isel(marker=[0]).assign_coords(marker=["wand"]) + 0.3
    rest = recording.drop_vars(["emg", "position", "channel", "marker"])
    return rest.assign(
        emg=xr.concat([hand, emg], "channel").assign_attrs(units="V"),
        position=xr.concat([wand, place], "marker").assign_attrs(units="m"),
    )


def of_another_name(recording: xr.Dataset) -> xr.Dataset:
    return recording.assign_attrs(volunteer="Zoe", repetition=7)


MEANS_NOTHING: dict[str, Callable[[xr.Dataset], xr.Dataset]] = {
    "cameras elsewhere": turned,
    "another clock": later,
    "another order": reordered,
    "electrodes exchanged within pairs": inverted,
    "offset of the amplifier": offset,
    "further channels and markers": more,
    "another volunteer": of_another_name,
}


@pytest.mark.parametrize("change", MEANS_NOTHING)
def test_a_change_without_meaning_changes_no_activation_and_no_score(
    change, trial, reference
) -> None:
    activation, motion, scores = reference
    changed = Trial(MEANS_NOTHING[change](trial.recording), trial.face)
    assert not changed.recording.identical(trial.recording)
    again = changed.activation().sel(muscle=activation["muscle"])
    np.testing.assert_allclose(again["activation"], activation["activation"], atol=1e-9)
    since = float(again["time"][0] - activation["time"][0])
    moved = motion.assign_coords(time=("time", motion["time"].values + since, {"units": "s"}))
    result = changed.scores(moved).sel(marker=scores["marker"])
    for name in ("rho", "amplitude_ratio", "rmse", "shift", "b_correlation"):
        np.testing.assert_allclose(result[name], scores[name], rtol=1e-7, atol=1e-9, err_msg=name)


def test_the_other_side_moves_as_its_mirror_image(trial, reference) -> None:
    """The generated face is symmetric: exchanged names and a negative x mirror motion and scores."""
    _, motion, scores = reference
    place = trial.recording["position"]
    flipped = place.copy(data=place.values * np.array([[[-1.0], [1.0], [1.0]]]))
    other = renamed(trial.recording.assign(position=flipped), channel="", marker="")
    changed = Trial(other, trial.face)
    mirror = changed.motion()
    result = renamed(changed.scores(mirror), marker="").sel(marker=scores["marker"])
    for name in ("rho", "amplitude_ratio", "shift"):
        np.testing.assert_allclose(result[name], scores[name], rtol=1e-5, atol=1e-7, err_msg=name)
    assert float(abs(result["rho"] - result["rho"].values[::-1]).max()) > 1e-3  # it is one-sided


def test_a_change_with_a_meaning_changes_the_scores(trial, reference) -> None:
    """The same comparison sees exchanged names of two markers, and channels of the other side."""
    _, motion, scores = reference
    names = [str(name) for name in trial.recording["marker"].values]
    i, j = names.index("upper_lateral_left"), names.index("corner_left")
    names[i], names[j] = names[j], names[i]
    other = Trial(trial.recording.assign_coords(marker=names), trial.face)
    assert float(abs(other.scores(motion)["rho"] - scores["rho"]).max()) > 1e-3
    sides = Trial(renamed(trial.recording, channel=""), trial.face).activation()
    assert float(abs(sides["activation"] - reference[0]["activation"]).max()) > 1e-3
