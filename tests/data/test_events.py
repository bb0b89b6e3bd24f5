"""Synchronisation of clocks, trials and repetitions, compared with known values."""

import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from emgface.errors import DataError, SignalError
from emgface.recordings.events import cut_trials, find_repetitions, read_events
from emgface.recordings.synchronise import cut, synchronise
from emgface.schema.validation import validate

RATE = 1000.0


def long(duration: float = 20.0) -> xr.Dataset:
    """Return EMG whose values are its times in microseconds, and a marker at its time in mm."""
    emg, marker = np.arange(int(duration * RATE)) / RATE, np.arange(int(duration * 100)) / 100
    return xr.Dataset(
        {
            "emg": (("channel", "time_emg"), emg[None] * 1e-6, {"units": "V"}),
            "position": (
                ("marker", "axis", "time_marker"),
                np.tile(marker * 1e-3, (1, 3, 1)),
                {"units": "m"},
            ),
        },
        {
            "channel": ["ZYG_L"],
            "marker": ["corner_left"],
            "axis": ["x", "y", "z"],
            "time_emg": ("time_emg", emg, {"units": "s"}),
            "time_marker": ("time_marker", marker, {"units": "s"}),
        },
        {"origin": "measured", "volunteer": "V01"},
    )


def test_markers_are_put_on_the_clock_of_the_emg() -> None:
    given = long()
    moved = synchronise(given, offset=0.35)
    np.testing.assert_allclose(moved["time_marker"], given["time_marker"] + 0.35, atol=1e-12)
    np.testing.assert_array_equal(moved["position"], given["position"])
    assert moved["time_marker"].attrs["units"] == "s"
    assert "0.35 s" in moved["time_marker"].attrs["clock_relation"]
    validate(moved, "recording")
    with pytest.raises(SignalError, match="expected an overlap: check the sign"):
        synchronise(given, offset=25.0)
    with pytest.raises(SignalError, match="lacks EMG or markers"):
        synchronise(given.drop_vars(["emg", "channel", "time_emg"]), offset=0.0)


def test_spans_are_cut_at_the_samples() -> None:
    piece = cut(long(), 2.0, 3.0)
    assert (piece.sizes["time_emg"], piece.sizes["time_marker"]) == (1001, 101)
    assert piece["emg"].values[0, 0] == 2e-6 and piece["time_emg"].values[0] == 0.0
    with pytest.raises(SignalError, match="contains 0 samples of time_emg"):
        cut(long(), 30.0, 31.0)


def test_trials_are_cut_by_events(tmp_path: Path) -> None:
    (tmp_path / "sub-1_task-all_events.tsv").write_text(
        "onset\tduration\ttrial_type\n2.0\t1.5\tA\n5.0\t1.0\tB\n8.0\t2.0\tA\n"
    )
    events = read_events(tmp_path / "sub-1_task-all_events.tsv")
    trials = list(cut_trials(long(), events, before=0.5, after=0.25))
    names = [(t.attrs["instruction"], t.attrs["repetition"]) for t in trials]
    assert names == [("A", 1), ("B", 1), ("A", 2)]
    starts = [t["emg"].values[0, 0] * 1e6 for t in trials]
    assert starts == pytest.approx([1.5, 4.5, 7.5])
    assert [t["time_emg"].values[-1] for t in trials] == pytest.approx([2.25, 1.75, 2.75])
    assert trials[2].attrs["cut_from"] == [7.5, 10.25]
    validate(trials[0], "recording")
    late = pd.DataFrame({"onset": [19.5, 2.0], "duration": [1.0, 1.0], "label": ["C", "A"]})
    written = []
    with pytest.raises(SignalError, match="event 'C' at 19.5 s needs 19.5 to 20.5 s and time_emg"):
        for trial in cut_trials(long(), late):  # the other events are cut before
            written.append(trial.attrs["instruction"])
    assert written == ["A"]


def test_a_negative_duration_is_refused_before_the_first_trial() -> None:
    """The trials before it were written, and the repeated command refused to replace them."""
    events = pd.DataFrame({"onset": [2.0, 5.0], "duration": [1.0, -1.0], "label": "A"})
    with pytest.raises(SignalError, match="the event at 5 s has the duration -1 s"):
        next(cut_trials(long(), events))


@pytest.mark.parametrize(
    ("onsets", "durations", "message"),
    [
        ([2.0, 3.0], [2.0, 2.0], "from 3 to 4 s"),
        ([3.0, 2.0], [2.0, 2.0], "from 3 to 4 s"),
        ([2.0, 3.0], [5.0, 1.0], "from 3 to 4 s"),
        ([2.0, 3.95], [2.0, 2.0], ""),
        ([5.0, 2.0, 9.0], [2.0, 3.0, 1.0], ""),
    ],
)
def test_trials_that_share_their_samples_are_warned_of(onsets, durations, message) -> None:
    events = pd.DataFrame({"onset": onsets, "duration": durations, "label": "A"})
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert len(list(cut_trials(long(), events))) == len(onsets)
    assert len(caught) == bool(message)
    assert all(message in str(one.message) for one in caught)


def test_invalid_events_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "events.tsv"
    for text, match in (
        ("time\tduration\n1\t2\n", "expected onset and duration"),
        ("onset\tduration\nx\t2\n", "expected seconds or n/a"),
        ("onset\tduration\nn/a\t2\n", "an event without onset"),
    ):
        path.write_text(text)
        with pytest.raises(DataError, match=match):
            read_events(path)


def test_the_events_of_the_published_example(shared: Path) -> None:
    root = shared / "recordings" / "bids-emg-examples" / "emg_Multimodal" / "sub-01"
    if not root.is_dir():
        pytest.skip("the BIDS example is not there")
    events = read_events(root / "sub-01_task-pullstand_events.tsv")
    assert set(events["label"]) == {"stimulus"} and set(events["duration"]) == {1.0}
    assert events["onset"].iloc[0] == 16.09725 and (np.diff(events["onset"]) > 0).all()


def bursts(noise: float) -> tuple[xr.DataArray, list[tuple[float, float]]]:
    rng = np.random.default_rng(8)
    spans = [(1.0, 2.5), (4.6, 6.0), (8.1, 9.7), (11.9, 13.2)]
    time = np.arange(int(15 * RATE)) / RATE
    drive = sum(np.where((time > a) & (time < b), 1.0, 0.0) for a, b in spans)
    # Two channels of very different gain, one of which is at rest throughout.
    values = np.stack([1e-4 * drive, 1e-6 * drive, 0 * time]) * rng.normal(size=(3, time.size))
    values += np.array([[1e-4], [1e-6], [1e-6]]) * noise * rng.normal(size=values.shape)
    coords = {"channel": ["a", "b", "c"], "time_emg": time}
    return xr.DataArray(values, coords, ("channel", "time_emg"), attrs={"units": "V"}), spans


@pytest.mark.parametrize("noise", [0.02, 0.1])
def test_repetitions_are_found_in_emg(noise: float) -> None:
    signal, spans = bursts(noise)
    repetitions = find_repetitions(signal)
    assert len(repetitions) == len(spans)
    for (start, stop), onset, duration in zip(
        spans, repetitions["onset"], repetitions["duration"], strict=True
    ):
        assert onset == pytest.approx(start, abs=0.1)
        assert onset + duration == pytest.approx(stop, abs=0.1)


def test_repetitions_are_found_in_motion() -> None:
    time = np.arange(1500) / 100
    way = sum(np.exp(-(((time - c) / 0.4) ** 2)) for c in (2.0, 6.0, 10.0, 13.0)) * 8e-3
    values = np.stack([way, 0.2 * way, 0 * way])[None]
    values += 2e-5 * np.random.default_rng(0).normal(size=values.shape)
    coords = {"marker": ["m"], "axis": ["x", "y", "z"], "time_marker": time}
    positions = xr.DataArray(values, coords, ("marker", "axis", "time_marker"))
    repetitions = find_repetitions(positions)
    centres = repetitions["onset"] + repetitions["duration"] / 2
    assert centres.to_list() == pytest.approx([2.0, 6.0, 10.0, 13.0], abs=0.1)


def test_recordings_without_bursts_are_refused() -> None:
    signal, _ = bursts(0.02)
    with pytest.raises(SignalError, match="expected rest between bursts"):
        find_repetitions(signal.isel(channel=[2]))
    with pytest.raises(SignalError, match="never changes"):
        find_repetitions(0 * signal)
    with pytest.raises(SignalError, match="no burst lasts 5 s"):
        find_repetitions(signal, least_duration=5.0, least_rest=0.1)
    with pytest.raises(SignalError, match="has gaps"):
        find_repetitions(signal.where(signal["time_emg"] > 1))


def test_repetitions_are_counted_in_time_and_labels_may_be_absent(tmp_path: Path) -> None:
    file = tmp_path / "sub-1_task-all_events.tsv"
    file.write_text("onset\tduration\ttrial_type\n8\t1\tA\n2\t1\tA\n5\t1\tn/a\n")
    trials = list(cut_trials(long().assign_attrs(instruction="C"), read_events(file)))
    cuts = [(t.attrs["instruction"], t.attrs["repetition"], t.attrs["cut_from"][0]) for t in trials]
    assert cuts == [("A", 1, 2.0), ("C", 1, 5.0), ("A", 2, 8.0)]
    absent = pd.DataFrame({"onset": [2.0], "duration": [1.0], "label": [np.nan]})
    (trial,) = cut_trials(long().assign_attrs(instruction="C"), absent)
    assert trial.attrs["instruction"] == "C"


def test_durations_below_zero_and_offsets_without_a_number_are_refused() -> None:
    events = pd.DataFrame({"onset": [5.0], "duration": [-1.0], "label": ["A"]})
    with pytest.raises(SignalError, match="at 5 s has the duration -1 s"):
        list(cut_trials(long(), events, after=2.0))
    for offset in (float("nan"), float("inf")):
        with pytest.raises(SignalError, match="expected a finite number"):
            synchronise(long(), offset=offset)
