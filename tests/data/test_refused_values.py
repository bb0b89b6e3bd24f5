"""Values that formats allow and a recording cannot mean: logical arrays, counts of size 0."""

from pathlib import Path

import numpy as np
import pytest
import scipy.io

from emgface.errors import ConfigurationError, DataError
from emgface.recordings.dataset import read_recording

SIDECAR = 'schema = "recording"\n[emg]\nfile = "a.{}"\n{}rate = 100.0\nunit = "uV"\n'


@pytest.mark.parametrize("variable", ["emg", "rec.emg"])
def test_logical_arrays_of_matlab_are_no_signal(variable: str, tmp_path: Path) -> None:
    values = np.random.default_rng(1).normal(size=(60, 3)) > 0
    content = {"emg": values, "rec": {"emg": values}}
    scipy.io.savemat(tmp_path / "a.mat", content)
    path = tmp_path / "a.toml"
    path.write_text(SIDECAR.format("mat", f'variable = "{variable}"\n'))
    with pytest.raises(DataError, match="contains bool of shape .*expected real numbers"):
        read_recording(path)


def test_counts_of_size_zero_are_refused_and_negative_ones_reverse_the_sign(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    rows = "\n".join(",".join(f"{v:.0f}" for v in 1e3 * row) for row in rng.normal(size=(30, 2)))
    (tmp_path / "a.csv").write_text(f"E1,E2\n{rows}\n")
    path = tmp_path / "a.toml"
    read = {}
    for step in (1.0, -1.0):
        path.write_text(SIDECAR.format("csv", f"step = {step}\n"))
        read[step] = read_recording(path)["emg"].values
    np.testing.assert_array_equal(read[1.0], -read[-1.0])
    path.write_text(SIDECAR.format("csv", "step = 0.0\n"))
    with pytest.raises(ConfigurationError, match="step is 0, so that every sample would be 0"):
        read_recording(path)
