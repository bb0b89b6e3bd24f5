"""Places of electrodes in EMG-BIDS."""

import json
from pathlib import Path

import pytest
import xarray as xr

from emgface.errors import DataError
from emgface.recordings.bids import bids_problems, write_bids
from emgface.recordings.dataset import read_recording

PLACES = {
    "channels": {
        "ZYG_L": {"signal_electrode": "E1", "reference": "E2"},
        "DAO_R": {"signal_electrode": "E3", "reference": "E2"},
    },
    "positions": {"E1": [20.0, 80.5, 0.0], "E2": [40.0, 100.0, 50.0], "E3": [10.0, 90.0, None]},
    "spaces": {"E1": "face", "E2": "face", "E3": "face"},
    "system": {
        "EMGCoordinateSystem": "Other",
        "EMGCoordinateUnits": "percent",
        "EMGCoordinateSystemDescription": "x: left to right; y: back to front",
    },
}


def test_places_of_electrodes_are_written_and_read_back(trial: xr.Dataset, tmp_path: Path) -> None:
    trial.attrs["electrodes"] = json.dumps(PLACES)
    path = write_bids(trial, tmp_path)[0]
    assert bids_problems(tmp_path) == []
    message = json.loads(read_recording(path).attrs["electrodes"])
    for part in ("positions", "spaces", "system"):
        assert message[part] == PLACES[part]
    for name, link in PLACES["channels"].items():
        assert link.items() <= message["channels"][name].items()
    assert message["channels"]["OOS_L"] == {"target_muscle": "orbicularis oris superior"}
    again = write_bids(read_recording(path), tmp_path / "again")[0]
    assert json.loads(read_recording(again).attrs["electrodes"]) == message


@pytest.mark.parametrize(
    ("text", "said"),
    [("name\tx\ty\nE1\tleft\t3\n", "x of the electrode 'E1' is 'left'"),
     ("name\tx\nE1\t2\n", "lacks the column 'y'")],
)  # fmt: skip
def test_damaged_places_are_refused(
    trial: xr.Dataset, tmp_path: Path, text: str, said: str
) -> None:
    trial.attrs["electrodes"] = json.dumps(PLACES)
    path = write_bids(trial, tmp_path)[0]
    next(path.parent.glob("*electrodes.tsv")).write_text(text)
    with pytest.raises(DataError, match=said):
        read_recording(path)
    with pytest.raises(DataError, match="'electrodes' is"):
        write_bids(trial.assign_attrs(electrodes="[1]"), tmp_path / "other")
