"""Every file among the real recordings is read, or refused with a helpful message."""

from pathlib import Path

import pytest

from emgface.errors import DataError
from emgface.recordings.dataset import read_recording
from emgface.recordings.inventory import inventory_table

BIDS = "bids-emg-examples"
READ = {
    "pyomeca/markers_analogs.c3d": {"channel": 38, "marker": 51},
    f"{BIDS}/emg_Multimodal/sub-01/motion/sub-01_task-pullstand_tracksys-mocap_motion.tsv": {
        "marker": 2
    },
}
"""Files that are read as they are, with what they hold."""
REFUSED = {
    "pyomeca/markers.trc": "declares 652 frames but contains 93",
    "resurfemg-poly5/vent_data_synth_pocc.Poly5": "contains neither EMG nor markers",
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


def test_every_file_gives_a_recording_or_an_error_in_one_sentence(shared: Path) -> None:
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
            sentence = str(caught.value)
            assert path.name in sentence
            text = REFUSED.get(name, "does not specify its contents, rate and units")
            assert text in sentence, sentence
    assert seen >= 12


def test_one_command_lists_every_file(shared: Path, root: Path) -> None:
    """With the sidecars of the tables and arrays, 8 of 16 are read; each has a row, a note too."""
    table = inventory_table(folder(shared), sidecars=root / "docs" / "recordings").set_index("file")
    refused = set(table.index[table["refusal"].notna()])
    no_positions = "face-landmarks/subject1_smile_1"
    assert refused == set(REFUSED) | {
        f"{no_positions}_landmarks.csv", f"{no_positions}_mouth_vertical_distance.csv",
        "artisynth-jaw/origin.txt",
    }  # fmt: skip
    assert len(table) == 16 and table.loc[list(refused), "findings"].isna().all()
    facts = {
        "pyomeca/markers_analogs.c3d": (38, 2000.0, 51, 100.0, 5.8),
        "biosignalsnotebooks/emg_bursts.h5": (1, 1000.0, None, None, 28.519),
        "subvocal-facial-emg/P001_A_Nao.csv.gz": (8, 250.0, None, None, 100.268),
        "oxazepam-facial-emg/24_FMOV_preprocessed.txt": (2, 100.0, None, None, 389.8),
    }
    for name, expected in facts.items():
        row = table.loc[name, ["channels", "emg_rate", "markers", "marker_rate", "duration"]]
        assert [None if v != v else pytest.approx(v, rel=1e-6) for v in row] == list(expected)
    assert "mains hum of 60 Hz" in table.loc["subvocal-facial-emg/P001_A_Nao.csv.gz", "findings"]
    slow = table.loc["oxazepam-facial-emg/24_FMOV_preprocessed.txt", "findings"]
    assert "2 channels" in slow and "sampled at 100 Hz, which contains nothing above 50 Hz" in slow
    assert "19 channels" in table.loc["pyomeca/markers_analogs.c3d", "findings"]


def test_landmarks_of_one_camera_are_not_positions(shared: Path, tmp_path: Path) -> None:
    source = folder(shared) / "face-landmarks" / "subject1_smile_1_landmarks.csv"
    if not source.is_file():
        pytest.skip("the landmarks are not there")
    (tmp_path / "a.toml").write_text(
        f'schema = "recording"\n[position]\nfile = "{source.name}"\nrate = 100\nunit = "mm"\n'
    )
    with pytest.raises(DataError, match="has no marker with columns ending in _x, _y, _z"):
        read_recording(tmp_path / "a.toml", folder=source.parent)
