"""Every file among the real recordings is read, or refused with the sentence that helps."""

from pathlib import Path

import pytest

from emgface.dataset import read_recording
from emgface.errors import DataError

BIDS = "bids-emg-examples"
READ = {
    "pyomeca/markers_analogs.c3d": {"channel": 38, "marker": 51},
    f"{BIDS}/emg_Multimodal/sub-01/motion/sub-01_task-pullstand_tracksys-mocap_motion.tsv": {
        "marker": 2
    },
}
"""Files that are read as they are, with what they hold."""
REFUSED = {
    "pyomeca/markers.trc": "announces 652 frames and holds 93",
    "resurfemg-poly5/vent_data_synth_pocc.Poly5": "holds neither EMG nor markers",
    f"{BIDS}/emg_CustomBipolarFace/sub-01/emg/sub-01_task-talking_emg.edf": "is in 'uV', and in 'V'",
    f"{BIDS}/emg_Multimodal/sub-01/emg/sub-01_task-pullstand_emg.edf": "expected an integer",
    f"{BIDS}/emg_Multimodal/sub-01/eeg/sub-01_task-pullstand_eeg.edf": "expected an integer",
}
"""Files that are refused, with a part of the sentence; the headers of two are damaged."""
SIGNALS = (".c3d", ".trc", ".poly5", ".edf", ".bdf", ".h5", ".csv", ".gz", ".txt", ".mat")


def folder(shared: Path) -> Path:
    recordings = shared / "recordings"
    if not recordings.is_dir():
        pytest.skip("the recordings are not there")
    return recordings


def test_no_file_gives_anything_but_a_recording_or_a_sentence(shared: Path) -> None:
    recordings = folder(shared)
    seen = 0
    for path in sorted(recordings.rglob("*")):
        name = path.relative_to(recordings).as_posix()
        if not (path.suffix.lower() in SIGNALS or name.endswith("_motion.tsv")):
            continue
        seen += 1
        if name in READ:
            trial = read_recording(path)
            assert {dim: trial.sizes[dim] for dim in READ[name]} == READ[name]
        else:
            with pytest.raises(DataError) as caught:
                read_recording(path)
            told = str(caught.value)
            assert path.name in told
            text = REFUSED.get(name, "does not say what it holds, its rate and its units")
            assert text in told, told
    assert seen >= 12


def test_landmarks_of_one_camera_are_no_positions(shared: Path, tmp_path: Path) -> None:
    source = folder(shared) / "face-landmarks" / "subject1_smile_1_landmarks.csv"
    if not source.is_file():
        pytest.skip("the landmarks are not there")
    (tmp_path / "a.toml").write_text(
        f'schema = "recording"\n[position]\nfile = "{source.as_posix()}"\nrate = 100\nunit = "mm"\n'
    )
    with pytest.raises(DataError, match="has no marker with columns ending in _x, _y, _z"):
        read_recording(tmp_path / "a.toml")
