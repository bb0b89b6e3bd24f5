"""Filters that a file states: a narrow band or a processed signal is a finding, others are none."""

import numpy as np
import pandas as pd
import pytest
from edfio import Edf, EdfSignal

from emgface.recordings.dataset import read_recording
from emgface.recordings.finding_codes import CODES
from emgface.recordings.findings import findings_in
from emgface.recordings.readers._filters import bands_of_table, stated_filters

EMG = np.random.default_rng(2).normal(0.0, 50.0, 4000)


@pytest.mark.parametrize(
    ("text", "codes"),
    [
        ("", []),
        ("HP:0.1Hz LP:500Hz N:50Hz", []),
        ("LP:   NaN Hz; HP:   NaN Hz; Notch: NaN", []),
        ("HP:20Hz LP:0.5kHz", []),
        ("HP: DC LP: 1kHz", []),
        ("HP:100Hz LP:450Hz", ["prefiltered"]),
        ("HP 10 Hz LP=150 Hz", ["prefiltered"]),
        ("Rectified, smoothed 50 ms", ["processed"]),
        ("RMS 50 ms LP:6Hz", ["processed", "prefiltered"]),
    ],
)
def test_the_filter_in_the_header_of_edf_is_compared_with_the_band_of_emg(tmp_path, text, codes):
    signal = EdfSignal(EMG, sampling_frequency=2000, label="ZYG_L", physical_dimension="uV",
                       prefiltering=text)  # fmt: skip
    Edf([signal]).write(tmp_path / "a.edf")
    findings = findings_in(read_recording(tmp_path / "a.edf"))
    assert [f.code for f in findings if f.name == "ZYG_L"] == codes
    assert all(CODES[f.code].verdict == "warning" and f.sentence for f in findings)


@pytest.mark.parametrize(
    ("low", "high", "message"),
    [
        ("n/a", "n/a", ""),
        ("10", "500", ""),
        ("0", "0", ""),
        ("50", "n/a", "a high-pass of 50 Hz,"),
        ("20", "200", "a low-pass of 200 Hz,"),
        ("100", "250", "a high-pass of 100 Hz and a low-pass of 250 Hz,"),
    ],
)
def test_cut_offs_in_a_table_of_bids_are_compared_with_the_band_of_emg(low, high, message):
    table = pd.DataFrame(
        {"name": ["a", "b"], "low_cutoff": [low, "99"], "high_cutoff": [high, "99"]}
    )
    findings = bands_of_table(table, ["a"])
    assert len(findings) == bool(message)
    assert all(message in one.clause for one in findings)
    assert bands_of_table(table[["name"]], ["a", "b"]) == []


def test_a_channel_without_a_filter_has_no_finding():
    assert stated_filters({}) == []
