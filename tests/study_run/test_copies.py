"""One recording that counts as several trials is reported by the check, the study and the report."""

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from emgface.cli import app
from emgface.recordings.dataset import write_recording
from emgface.report.provenance import repeated
from tests.data.made_recordings import noise, recording

TRIALS = [("V1", "A", 1), ("V1", "A", 2), ("V2", "A", 1)]


def checked(folder) -> str:
    return " ".join(CliRunner().invoke(app, ["check", str(folder)]).output.split())


@pytest.mark.parametrize("copied", [0, 1, 2])
def test_a_check_of_a_folder_tells_of_copies(tmp_path, copied):
    for k, (volunteer, instruction, repetition) in enumerate(TRIALS):
        made = recording(noise(rows=2, seconds=2.5, seed=0 if k <= copied else k))
        attrs = {"volunteer": volunteer, "instruction": instruction, "repetition": repetition}
        write_recording(
            made.assign_attrs(attrs), tmp_path / f"{volunteer}_{instruction}_{repetition}.nc"
        )
    text = checked(tmp_path)
    assert ("contain the same samples" in text) == (copied > 0)
    assert (
        not copied or f"V1_A_1.nc, V1_A_2.nc{', V2_A_1.nc' if copied == 2 else ''} contain" in text
    )


@pytest.mark.parametrize(
    ("digests", "message"),
    [
        (["a", "b", "c", ""], []),
        (["", "", "a", "b"], []),
        (["a", "a", "b", ""], ["V1 A 1, V1 A 2 have"]),
        (["a", "b", "a", "b"], ["V1 A 1, V2 A 1 have", "V1 A 2, V2 A 2 have"]),
    ],
)
def test_a_cube_that_was_joined_of_copies_is_reported(digests, message):
    dims = ("volunteer", "instruction", "repetition")
    cube = xr.Dataset(
        {name: (dims, np.array(digests, dtype=str).reshape(2, 1, 2)) for name in
         ("recording", "recording_digest")},
        {"volunteer": ["V1", "V2"], "instruction": ["A"], "repetition": [1, 2]},
    )  # fmt: skip
    sentences = repeated(cube)
    assert len(sentences) == len(message)
    assert all(part in text for part, text in zip(message, sentences, strict=True))
    assert repeated(cube.drop_vars(["recording", "recording_digest"])) == []
