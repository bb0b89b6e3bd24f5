"""Blocks of samples that a recording contains twice: a finding, but none for quiet signals."""

import numpy as np
import pytest
import xarray as xr

from emgface.recordings.check import findings_of
from emgface.recordings.findings import Finding
from emgface.recordings.quality.blocks import blocks_stored_twice

RATE = 2000.0
RNG = np.random.default_rng(8)
NOISE = RNG.normal(size=(3, 12000))


def smooth(samples: int, width: int) -> np.ndarray:
    kernel = np.hanning(width) / np.linalg.norm(np.hanning(width))
    return np.convolve(np.random.default_rng(2).normal(size=samples), kernel, "same")[None]


TIME = np.arange(40000) / RATE
QUIET = {
    "constant": np.zeros((3, 8000)),
    "noise": NOISE,
    "two levels": np.sign(NOISE),
    "mostly zero": np.round(0.3 * RNG.normal(size=(1, 100_000))),
    "three levels": np.round(0.5 * RNG.normal(size=(1, 100_000))),
    "slow and quantised": np.round(2.0 * smooth(60_000, 60)),
    "gaps": np.where(np.arange(12000) % 3000 < 1500, np.nan, NOISE),
    "held": np.repeat(NOISE[:, :200], 60, axis=1),
    "hum": np.round(10.0 * np.sin(2 * np.pi * 50.0 * TIME))[None],
    "other hum": np.round(
        10.0 * np.sin(2 * np.pi * 50.03 * TIME) + 0.3 * RNG.normal(size=TIME.size)
    )[None],
}
"""Signals without a block that is stored twice, shape (channels, samples)."""


@pytest.mark.parametrize("name", QUIET)
def test_quiet_constant_and_periodic_signals_contain_no_block(name: str) -> None:
    assert blocks_stored_twice(QUIET[name], RATE) == []


def test_every_kind_of_block_is_found() -> None:
    signals = [NOISE, np.sign(NOISE), np.round(0.5 * NOISE), np.round(2.0 * smooth(12000, 60))]
    for values in signals:
        for start, stop, again in ((3000, 5000, 5000), (3000, 5000, 9000), (0, 4000, 4000)):
            twice = np.concatenate(
                [values[:, :again], values[:, start:stop], values[:, again:]], axis=1
            )
            (block,) = blocks_stored_twice(twice, RATE)
            assert block.start - block.first == again - start
            # Samples next to a block agree by chance if a signal has few levels.
            assert abs(block.start - again) < 60 and abs(block.samples - (stop - start)) < 60
    replaced = NOISE.copy()
    replaced[:, 6000:8000] = replaced[:, 2000:4000]
    replaced[:, 9000:9500] = replaced[:, 100:600]
    assert blocks_stored_twice(replaced, RATE) == [(6000, 2000, 2000), (9000, 500, 100)]
    assert [b[:2] for b in blocks_stored_twice(np.tile(NOISE, 2), RATE)] == [(12000, 12000)]


def test_one_channel_that_differs_is_no_block() -> None:
    twice = NOISE.copy()
    twice[:2, 6000:8000] = twice[:2, 2000:4000]
    assert blocks_stored_twice(twice, RATE) == []


def recording_of(emg: np.ndarray, position: np.ndarray) -> xr.Dataset:
    emg_time, time = np.arange(emg.shape[1]) / RATE, np.arange(position.shape[2]) / 100.0
    return xr.Dataset(
        {
            "emg": (("channel", "time_emg"), emg, {"units": "V"}),
            "position": (("marker", "axis", "time_marker"), position, {"units": "m"}),
        },
        {
            "channel": ["ZYG_L", "ZYG_R", "MEN_L"],
            "marker": ["nasion"],
            "axis": list("xyz"),
            "time_emg": ("time_emg", emg_time, {"units": "s"}),
            "time_marker": ("time_marker", time, {"units": "s"}),
        },
    )


@pytest.mark.parametrize(("kind", "scale"), [("channel", 1e-5), ("marker", 1e-3)])
def test_the_check_of_a_recording_states_the_block(kind: str, scale: float) -> None:
    def stored(values: np.ndarray) -> list[Finding]:
        emg = 1e-5 * NOISE if kind == "marker" else scale * values
        position = scale * (values if kind == "marker" else RNG.normal(size=(3, 900)))[None]
        every = findings_of(recording_of(emg, position))
        return [f for f in every if f.code == "stored_twice"]

    values = RNG.normal(size=(3, 8000 if kind == "channel" else 900))
    assert stored(values) == []
    size = 2000 if kind == "channel" else 100
    values[:, 2 * size - 100 : 3 * size - 100] = values[:, :size]
    (finding,) = stored(values)
    rate = RATE if kind == "channel" else 100.0
    assert (finding.kind, finding.verdict, finding.values["count"]) == (kind, "warning", 1)
    assert finding.values["at"] == pytest.approx((2 * size - 100) / rate)
    assert finding.values["seconds"] == pytest.approx(size / rate)
