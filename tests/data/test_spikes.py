"""Single samples of EMG far from both neighbours."""

import numpy as np
import pytest

from emgface.recordings.check import check_recording, problems
from emgface.recordings.quality.spikes import spikes
from tests.data.made_recordings import noise, recording


@pytest.mark.parametrize("height", [30.0, -9999.0])
def test_single_samples_are_found(height: float) -> None:
    """One damaged sample in independent noise is found at its place, whatever its sign."""
    values = np.random.default_rng(0).standard_normal(5000)
    values[1234] += height
    spike_table = spikes(values, 2000.0)
    assert spike_table.at.tolist() == [1234]
    assert spike_table.distance[0] == pytest.approx(abs(height), abs=5.0)


@pytest.mark.parametrize("rate", [200.0, 1000.0, 2148.1, 50e3])
def test_spikes_of_a_reversed_signal_are_the_same(rate: float) -> None:
    """No side of a sample has an advantage, at even and odd numbers of samples around it."""
    values = np.random.default_rng(2).standard_normal(5000)
    values[[1000, 4200]] += 50.0, -70.0
    forward, back = spikes(values, rate).at, 4999 - spikes(values[::-1], rate).at[::-1]
    assert forward.tolist() == back.tolist() == [1000, 4200]


def test_the_level_and_a_drift_of_a_signal_do_not_matter() -> None:
    """A second difference is neither changed by a constant nor by a straight line."""
    values = np.random.default_rng(2).standard_normal(5000)
    values[[1000, 4200]] += 50.0, -70.0
    alone, lifted = spikes(values, 2000.0), spikes(values + 1e3 + 0.1 * np.arange(5000), 2000.0)
    assert lifted.at.tolist() == alone.at.tolist() == [1000, 4200]
    np.testing.assert_allclose(lifted.distance, alone.distance, rtol=1e-9)


@pytest.mark.parametrize("kind", ["noise", "bursts", "units", "steps", "rare steps", "gap", "jump"])
def test_signals_without_spikes(kind: str) -> None:
    """Noise, bursts, action potentials, the resolution and gaps are no spikes (200 channels each)."""
    rng = np.random.default_rng(1)
    for _ in range(200):
        noise = rng.standard_normal(5000)
        if kind == "bursts":
            noise = np.convolve(noise, np.hanning(5), "same") * (
                1 + 9 * (np.arange(5000) % 1000 > 600)
            )
        elif kind == "units":
            trains = (rng.random(5000) < 0.004).astype(float)
            noise = np.convolve(trains, [0, 15, 50, -40, -20, 5], "same") + 0.5 * noise
        elif kind == "steps":
            noise = np.round(0.35 * noise)
        elif kind == "rare steps":
            noise = np.round(0.2 * noise)
        elif kind == "jump":
            noise[2500:] += 1000.0
        elif kind == "gap":
            noise[2000:2300] = np.nan
            noise[2301] = np.nan
        assert not spikes(noise, 2000.0).at.size


def test_spikes_are_said() -> None:
    """A recording with a damaged number has a finding with its time and size."""
    values = noise()
    values[6, 700] += 0.5
    (sentence,) = problems(check_recording(recording(values)), "warning")
    assert "MEN_L: samples far from both neighbours: 1, the first at 0.34" in sentence
    assert "5e+05 uV" in sentence
