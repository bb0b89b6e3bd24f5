"""The notebook *From a C3D file to muscle activations* with the real recordings: how far each goes."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from emgface.errors import ConfigurationError, MarkerError, SchemaError, UnitsError
from emgface.inverse.run import invert
from emgface.inverse.signals import estimated_activation
from emgface.muscles import CHANNELS, FACE_MARKERS, LIP_MARKERS, MUSCLES
from emgface.recordings.dataset import read_recording
from emgface.signals.parameters import SignalChain
from tests.inverse.recordings import recording_of

SHOULDER = (
    "Delt_ant.EMG1", "Delt_med.EMG2", "Delt_post.EMG3", "Biceps.EMG4", "Triceps.EMG5", "Trap_sup.EMG6",
    "Trap_inf.EMG7", "Gd_dent.EMG8", "Supra.EMG9", "Infra.EMG10",
)  # fmt: skip
"""Channels of the only C3D file, in the place of ten of a face."""
GIVEN = dict(zip(SHOULDER, CHANNELS, strict=False))
TRIAL = {"volunteer": "S01", "instruction": "D", "repetition": 1}
pytestmark = pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")


def test_its_sEMG_becomes_activation_and_absent_muscles_are_named(real_c3d: Path) -> None:
    recording = read_recording(real_c3d, mapping=TRIAL | {"channels": GIVEN})
    estimate = estimated_activation(recording, SignalChain(), "assisted", None)
    a = estimate["activation"].sel(muscle=["ZYG_L", "RIS_L", "DAO_L", "MEN_L"])
    assert 0.0 <= float(a.min()) and float(a.max()) <= 1.0
    assert (a.max("time") > 0.9).all() and (a.std("time") > 0.02).all()
    assert float(estimate["time"][-1]) == pytest.approx(5.75, abs=0.1)
    right = {m for m in MUSCLES if m.endswith("_R")}
    missing = set(estimate.attrs["missing"].split())
    assert missing < right and {"ZYG_R", "LLSAN_R", "DAO_R", "MEN_R"} <= missing


def test_its_markers_are_not_those_of_a_face(real_c3d: Path, coarse: xr.Dataset) -> None:
    recording = read_recording(real_c3d, mapping=TRIAL | {"channels": GIVEN})
    with pytest.raises(MarkerError, match="missing markers .* expected six face and ten lip"):
        invert(recording, coarse)
    names = read_recording(real_c3d)["position"]
    seen = [str(m) for m in names["marker"].values if np.isfinite(names.sel(marker=m)).all()]
    labels = dict(zip(seen, (*FACE_MARKERS, *LIP_MARKERS), strict=False))
    wrong = read_recording(real_c3d, mapping=TRIAL | {"channels": GIVEN, "markers": labels})
    with pytest.raises(UnitsError, match="check the unit of the positions"):
        invert(wrong, coarse)


def test_its_sEMG_with_the_markers_of_a_face_is_inverted(
    real_c3d: Path, coarse: xr.Dataset
) -> None:
    """Real channels and simulated markers on one clock: every step of the notebook runs."""
    from emgface.face.simulation_parameters import SimulationParameters
    from emgface.inverse.parameters import InverseParameters

    emg = read_recording(real_c3d, mapping=TRIAL | {"channels": GIVEN})
    markers = recording_of(coarse)
    both = markers.drop_vars(["emg", "time_emg", "channel"])
    both = both.merge(emg[["emg"]].sel(time_emg=slice(2.0, 3.2)).assign_coords(
        time_emg=("time_emg", emg["time_emg"].sel(time_emg=slice(2.0, 3.2)).values - 2.0, {"units": "s"})
    ))  # fmt: skip
    both.attrs = markers.attrs
    free = SimulationParameters(
        solver="linearly_implicit", gravity=False, contact={"method": "none"}, output=0.04,
        sigma_max=115e3,
    )  # fmt: skip
    inverse = invert(both, coarse, free, parameters=InverseParameters(form="step"))
    assert {"ZYG_R", "MEN_R"} <= set(inverse.attrs["missing"].split())
    assert 0.0 <= float(inverse["activation"].min()) and float(inverse["activation"].max()) <= 1.0
    assert np.isfinite(inverse["misfit"]).all() and np.isfinite(inverse.attrs["emg_agreement"])


@pytest.mark.parametrize(
    ("name", "lacks"),
    [
        ("biosignalsnotebooks/emg_bursts.h5", "position"),
        ("oxazepam-facial-emg/24_FMOV_preprocessed.txt", "position"),
        ("subvocal-facial-emg/P001_A_Nao.csv.gz", "position"),
        ("artisynth-jaw/jawPosition.txt", "emg"),
    ],
)
def test_the_other_files_lack_markers_or_sEMG(
    shared: Path, root: Path, coarse: xr.Dataset, tmp_path: Path, name: str, lacks: str
) -> None:
    folder = shared / "recordings"
    if not (folder / name).is_file():
        pytest.skip("the recording is not there")
    (tmp_path / "trial.toml").write_text(sidecar_of(root, name), encoding="utf-8")
    recording = read_recording(tmp_path / "trial.toml", folder=folder)
    assert lacks not in recording
    refused = (MarkerError, ConfigurationError, SchemaError)
    with pytest.raises(refused, match="marker|no sEMG|expected at least one of OOS_L"):
        invert(recording, coarse)


def sidecar_of(root: Path, name: str) -> str:
    """Description in docs/recordings of a file by its name."""
    texts = [
        path.read_text(encoding="utf-8") for path in (root / "docs" / "recordings").glob("*.toml")
    ]
    return next(text for text in texts if f'"{name}"' in text)
