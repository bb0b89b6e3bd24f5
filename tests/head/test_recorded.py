"""A head driven by a recording of face and jaw: levels, motion, and scores against the known motion."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

from emgface.anatomy.head.build import build_head
from emgface.anatomy.head.incisor import with_incisor
from emgface.anatomy.head.model import Head, write_head
from emgface.anatomy.head.recorded import (
    RecordedDrive,
    excitation_of_head,
    move_as_recorded,
    score_head,
)
from emgface.anatomy.head.run import simulate_head
from emgface.anatomy.jaw.series import ramps
from emgface.choices import configure
from emgface.errors import FeatureWarning, HeadError
from emgface.muscles import FACE_MARKERS, LIP_MARKERS
from emgface.report import jaw as report_of_jaw
from emgface.run.store import Store
from emgface.study.configuration import FaceConfiguration, StudyConfiguration
from emgface.study.file import study_face
from emgface.study.stages import Laboratory

RATE, START, DURATION = 2000.0, 10.0, 0.9
STUDY = configure(
    StudyConfiguration,
    {
        "signals": {
            "feature": {"kind": "rms"},
            "normalisation": {"outside": "clip", "reach": "reference"},
        },
        "simulation": {"contact": {"method": "none"}, "sigma_max": 100e3},
    },
    where="test",
)
TRUTH = {"OOS": 0.0, "OOI": 0.0, "RIS": 0.4, "ZYG": 0.6, "LLSAN": 0.1, "DAO": 0.0, "MEN": 0.1}
"""Level of every channel of the face in the middle of the trial."""


def _bump(t: np.ndarray) -> np.ndarray:
    return np.clip(1.0 - np.abs(t - 0.5 * DURATION) / 0.25, 0.0, 1.0)


@pytest.fixture(scope="module")
def head() -> Head:
    return build_head(["face", "jaw"], preset="man", resolution=400, contacts=[])


@pytest.fixture(scope="module")
def recording(head: Head) -> xr.Dataset:
    """Smile with an opening jaw: noise with the envelopes of its drive, and its markers."""
    t = np.linspace(0.0, DURATION, 91)
    corners = {f"bi_{m}": list(zip(t, a * _bump(t), strict=True)) for m, a in TRUTH.items() if a}
    corners["bi_open"] = list(zip(t, 0.1 * _bump(t), strict=True))
    corners["bi_close"] = [(0.0, 4e-4)]
    truth = simulate_head(
        head, ramps(corners), duration=DURATION, step=1e-2, gravity=False, face=STUDY.simulation
    )
    rng = np.random.default_rng(1)
    time_emg = START + np.arange(int(DURATION * RATE)) / RATE
    levels = {**TRUTH, "DIG": 0.5, "MAS": 0.0, "TEM": 0.0}
    names = [f"{m}_{side}" for side in "LR" for m in levels]
    envelope = np.outer([levels[n[:-2]] for n in names], _bump(time_emg - START))
    emg = 2e-4 * envelope * rng.standard_normal(envelope.shape)
    emg += 2e-6 * rng.standard_normal(emg.shape)
    still = head.parts["face"]["face_marker_position"].values
    lips = truth["position"].sel(marker=[*LIP_MARKERS, "lower_incisor"])
    frames = lips.transpose("marker", "axis", "time").values
    fixed = np.broadcast_to(still[..., None], (*still.shape, frames.shape[-1]))
    return xr.Dataset(
        {
            "emg": (("channel", "time_emg"), emg, {"units": "V"}),
            "position": (
                ("marker", "axis", "time_marker"),
                np.concatenate([fixed, frames]),
                {"units": "m"},
            ),
        },
        coords={
            "channel": names,
            "marker": [*FACE_MARKERS, *LIP_MARKERS, "lower_incisor"],
            "axis": ["x", "y", "z"],
            "time_emg": ("time_emg", time_emg, {"units": "s"}),
            "time_marker": ("time_marker", START + truth["time"].values, {"units": "s"}),
        },
        attrs={"origin": "simulated", "volunteer": "v", "instruction": "C", "repetition": 1},
    )


@pytest.fixture(scope="module")
def effort(recording: xr.Dataset) -> xr.Dataset:
    """Maximum effort of all channels."""
    noise = 2e-4 * np.random.default_rng(2).standard_normal(recording["emg"].shape)
    t = (recording["time_emg"].values - START) / DURATION
    return recording.assign(emg=(("channel", "time_emg"), noise * (t > 0.3), {"units": "V"}))


def test_levels_of_face_and_jaw_share_their_time(
    head: Head, recording: xr.Dataset, effort: xr.Dataset
) -> None:
    drive = RecordedDrive(STUDY, "act_all", effort=[effort])
    levels = excitation_of_head(recording, head, drive)
    peak = {name: levels.time[np.argmax(u)] for name, u in levels.values.items()}
    assert levels.recorded_start is not None
    middle = START + 0.5 * DURATION - levels.recorded_start
    for name in ("ZYG_L", "ZYG_R", "ad_L", "my_R"):
        assert abs(peak[name] - middle) < 0.15, name
        assert levels.values[name].max() > 0.2
    assert (levels.values["bi_close"] == 4e-4).all()
    later = recording.assign_coords(
        time_emg=recording["time_emg"] + 5.0, time_marker=recording["time_marker"] + 5.0
    )
    shifted = excitation_of_head(later, head, drive)
    np.testing.assert_allclose(shifted.time, levels.time, atol=1e-9)
    assert shifted.recorded_start == pytest.approx(levels.recorded_start + 5.0)


def test_recorded_motion_is_followed_and_scored(
    head: Head, recording: xr.Dataset, effort: xr.Dataset
) -> None:
    drive = RecordedDrive(STUDY, "act_all", effort=[effort])
    motion = move_as_recorded(recording, head, drive, step=1e-2)
    assert motion["time"].values[0] == 0.0 and motion.attrs["origin"] == "simulated"
    scores = score_head(recording, motion, head, drive)
    rho = scores["rho"].to_series()
    assert rho["lower_incisor"] > 0.8 and rho["corner_left"] > 0.8
    # the head begins at rest: it does not sag when the recording starts
    x = motion["position"].sel(marker="corner_left").transpose("time", "axis").values
    assert np.linalg.norm(x[3] - x[0]) < 2e-4
    exchanged = recording.assign_coords(
        channel=[str(c).replace("DIG", "???").replace("MAS", "DIG").replace("???", "MAS")
                 for c in recording["channel"].values]
    )  # fmt: skip
    closed = move_as_recorded(exchanged, head, drive, step=1e-2)
    own, other = (
        np.ptp(m["position"].sel(marker="lower_incisor", axis="z").values) for m in (motion, closed)
    )
    assert own > 5.0 * other


def test_recordings_and_heads_that_cannot_be_coupled(head: Head, recording: xr.Dataset) -> None:
    face = recording.sel(channel=[c for c in recording["channel"].values if c[:-2] in TRUTH])
    with pytest.raises(HeadError, match=r"no channel of the jaw .*emgface simulate"):
        excitation_of_head(face, head)
    with pytest.raises(HeadError, match="the head has no face"):
        excitation_of_head(recording, build_head(["jaw"]))


def test_the_report_of_a_study_scores_the_incisor_of_a_head_that_nods(
    head: Head, recording: xr.Dataset, tmp_path: Path
) -> None:
    """Recorded as simulated, rho is 1: relative to the skull, as the lips are."""
    study = STUDY.model_copy(
        update={"face": FaceConfiguration(head=write_head(head, tmp_path / "head.nc"))}
    )
    laboratory = Laboratory(Store(tmp_path / "store"), study_face(study.face), study, print)
    t = np.linspace(0.0, 0.8, 81)
    k = recording["marker"].values.tolist().index("lower_incisor")
    path = recording["position"].values[k, :, :1] + 1e-2 * np.array(
        [0.1 * t, np.sin(4.0 * t), np.sin(8.0 * t) - t]
    )
    motion = xr.Dataset(
        {"incisor": (("axis", "time"), path, {"units": "m"})},
        {"axis": ["x", "y", "z"], "time": ("time", t, {"units": "s"})},
        {"recorded_start": START, "origin": "simulated", "incisor_error": 1e-4},
    )
    time = START + t
    x = recording["position"].values[:, :, :1].repeat(len(time), axis=2)
    x[k] = path
    nods = Rotation.from_euler(
        "x", np.linspace(0.0, 10.0, len(time))[:, None], degrees=True
    ).as_matrix()
    seen = recording.isel(time_marker=[0]).drop_dims("time_marker").assign(
        position=(
            ("marker", "axis", "time_marker"), np.einsum("tij,mjt->mit", nods, x), {"units": "m"}
        )
    )  # fmt: skip
    seen = seen.assign_coords(time_marker=("time_marker", time, {"units": "s"}))
    cube = xr.Dataset(coords={"strategy": ["act_all"]})
    trial = SimpleNamespace(recording=SimpleNamespace(dataset=seen), motion=motion)
    results: Any = SimpleNamespace(
        laboratory=laboratory, study=laboratory.study, base=cube, notes=[],
        trial=lambda place, strategy: trial,
    )  # fmt: skip
    with patch.object(report_of_jaw, "representative", lambda cube: {"C": ("v", "C", 1)}):
        section = report_of_jaw.incisors(results)
        assert not results.notes and section is not None
        rows = {row[1]: row[3:] for row in section.table.rows}
        assert section.table.rows[0][:3] == ("v C 1 act_all", "simulated", "lower_incisor")
        rho, ratio, rmse, _ = rows["simulated"]
        assert rho > 0.999 and ratio == pytest.approx(1.0, abs=0.02) and rmse < 1e-4
        assert rows["none (the point rests)"][2] > 1e-3
        assert section.figure.axes and "time steps" in section.table.note
        given = motion, laboratory.face, laboratory.study.signals.head_frame
        scored = with_incisor(xr.Dataset(), seen, *given)
        assert float(scored["incisor_rho"]) == pytest.approx(rho, abs=1e-12)
        assert float(scored["incisor_rmse"]) == pytest.approx(rmse, abs=1e-12)
        metres = seen.assign(
            position=1e3 * seen["position"].where(seen["marker"] == "lower_incisor")
        )
        metres["position"] = metres["position"].fillna(seen["position"])
        refused = with_incisor(xr.Dataset(), metres, *given)
        assert not refused.data_vars and "check the unit" in refused.attrs["incisor_reason"]
        trial.recording.dataset = seen.sel(marker=list(FACE_MARKERS))
        assert not with_incisor(xr.Dataset(), trial.recording.dataset, *given).attrs
        assert report_of_jaw.incisors(results) is None


def test_a_study_moves_a_head_where_the_jaw_was_recorded_and_the_face_elsewhere(
    head: Head, recording: xr.Dataset, tmp_path: Path
) -> None:
    """The same laboratory: lips and an error of the head, and the bits of the face alone."""
    path = write_head(head, tmp_path / "head.nc")
    study = STUDY.model_copy(
        update={
            "face": FaceConfiguration(head=path),
            "signals": STUDY.signals.model_copy(
                update={
                    "normalisation": STUDY.signals.normalisation.model_copy(
                        update={"reach": "trial"}
                    )
                }
            ),
        }
    )
    face = study_face(study.face)
    alone = recording.sel(channel=[c for c in recording["channel"].values if c[:-2] in TRUTH])
    trials = []
    for k, own in enumerate((recording, alone)):
        trial: Any = SimpleNamespace(
            digest=f"digest {k}",
            label=f"r{k}",
            dataset=own,
            channels=tuple(map(str, own["channel"].values)),
        )
        laboratory = Laboratory(Store(tmp_path / "store"), face, study, print)
        if own is alone:
            made = laboratory.activation(trial, "act_all")
        else:  # nothing closes the jaw, and no reference tells it from a contraction
            with pytest.warns(FeatureWarning, match="TEM_L, MAS_L, TEM_R, MAS_R"):
                made = laboratory.activation(trial, "act_all")
        activation = made.dataset["activation"]
        activation = activation.isel(time=slice(35, 50))
        trials.append((laboratory, activation, laboratory.motion(activation, trial.label)))
    (laboratory, levels, moved), (_, of_face, still) = trials
    assert {"ad_L", "ip_R"} < set(levels["muscle"].values) and len(of_face["muscle"]) == 20
    motion = moved.dataset
    assert motion["marker"].values.tolist() == list(LIP_MARKERS)
    assert 0.0 < motion.attrs["numerical_error"] < 2e-3
    apart = motion["position"] - still.dataset["position"]
    assert np.abs(apart.values).max() > 2e-3
    opened = motion["incisor"].sel(axis="z")
    assert float(opened[0] - opened.min()) > 1e-3 > motion.attrs["incisor_error"] > 0.0
    skin = laboratory.skin_motion(levels, motion.attrs["sigma_max"], "r0").dataset
    drawn = motion["position"].sel(time=skin["time"], method="nearest")
    np.testing.assert_allclose(skin["position"], drawn.transpose("time", ...), atol=1e-12)
    plain = Laboratory(
        Store(tmp_path / "other"),
        face,
        study.model_copy(update={"face": FaceConfiguration()}),
        print,
    )
    assert (plain.motion(of_face, "r1").dataset["position"] == still.dataset["position"]).all()
