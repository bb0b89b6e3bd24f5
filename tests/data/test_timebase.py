"""Time bases against closed forms: gaps, jitter, counters, contradictions."""

import numpy as np
import pytest

from emgface.errors import DataError
from emgface.recordings.counters import counter_of
from emgface.recordings.timebase import contradicting, of_blocks, of_rate, of_stamps, with_counter

RATE = 1000.0
RNG = np.random.default_rng(7)


def lost(*spans: tuple[int, int], samples: int = 4000) -> np.ndarray:
    """Indices of the samples that remain after the loss of some (first, number)."""
    keep = np.ones(samples, dtype=bool)
    for first, number in spans:
        keep[first : first + number] = False
    return np.flatnonzero(keep)


@pytest.mark.parametrize("nominal", [RATE, None])
@pytest.mark.parametrize(
    "spans", [(), ((1000, 1),), ((1000, 900),), ((10, 2), (13, 5), (3000, 40))]
)
def test_lost_samples_are_gaps_at_their_places(spans, nominal) -> None:
    kept = lost(*spans)
    base = of_stamps("a", 5.0 + kept / RATE, nominal=nominal)
    assert [(gap.after, gap.samples) for gap in base.gaps] == [
        (int(np.searchsorted(kept, first)) - 1, number) for first, number in spans
    ]
    np.testing.assert_allclose(base.times, 5.0 + np.arange(4000) / RATE, atol=1e-9)
    laid = base.laid(kept.astype(float))
    expected = np.full(4000, np.nan)
    expected[kept] = kept
    np.testing.assert_array_equal(laid, expected)
    assert len(base.findings("channel")) == len(spans)


@pytest.mark.parametrize("jitter", [1e-4, 3e-3, 2e-2])
def test_jitter_of_arrival_is_no_gap_and_hides_none(jitter: float) -> None:
    kept = lost((2000, 300))
    late = np.repeat(RNG.uniform(0, jitter, -(-kept.size // 32)), 32)[: kept.size]
    base = of_stamps("a", kept / RATE + late, nominal=RATE, jittered=True)
    (gap,) = base.gaps
    assert gap.after == 1999
    assert abs(gap.samples - 300) <= 1e3 * jitter
    whole = np.arange(4000) / RATE
    late = np.repeat(RNG.uniform(0, jitter, 125), 32)
    fitted = of_stamps("a", whole + late, nominal=RATE, jittered=True)
    assert not fitted.gaps
    assert np.abs(fitted.times - whole - jitter / 2).max() < jitter / 2


def test_times_rounded_to_milliseconds_keep_their_rate() -> None:
    base = of_stamps("a", np.round(np.arange(20000) / 2148.148, 3))
    assert base.rate == pytest.approx(2148.148, rel=1e-6)
    assert not base.gaps


def test_chunks_out_of_order_are_sorted_and_reported() -> None:
    stamps = np.arange(2000) / RATE
    order = np.r_[0:500, 600:700, 500:600, 700:2000]
    base = of_stamps("a", stamps[order], nominal=RATE)
    np.testing.assert_array_equal(base.laid(order.astype(float)), np.arange(2000.0))
    assert [f.code for f in base.findings("channel")] == ["reordered"]


def test_a_wrong_nominal_rate_is_reported_and_the_times_are_used() -> None:
    base = of_stamps("a", np.arange(3000) / RATE, nominal=2000.0)
    assert base.rate == pytest.approx(RATE, rel=1e-12)
    (finding,) = base.findings("channel")
    assert (finding.code, finding.values["other"], finding.values["seconds"]) == (
        "rate",
        2000.0,
        1.5,
    )


@pytest.mark.parametrize(
    ("stamps", "message"),
    [
        (np.r_[np.arange(50), np.nan, np.arange(51, 99)], "1 of 99 samples have no time, the first is"),
        (np.zeros(30), "all 30 samples are at 0 s"),
        (np.tile(np.arange(500) / RATE, 2), "samples share their time"),
        (np.arange(2000) ** 2 * 1e-6, "away from uniform samples"),
        (np.r_[np.arange(50.0), 5000.0], "lacks 4950 samples between the 51"),
    ],
)  # fmt: skip
def test_times_that_cannot_be_placed_are_refused(stamps: np.ndarray, message: str) -> None:
    with pytest.raises(DataError, match=message):
        of_stamps("a", stamps)


def test_losses_that_no_interval_shows_are_refused() -> None:
    chunk = np.arange(32) / RATE  # the device's own times within a chunk, and slower chunks
    stamps = np.concatenate([chunk + k * 0.0325 for k in range(200)])
    with pytest.raises(DataError, match="no interval shows where they are|away from uniform"):
        of_stamps(
            "a", stamps + RNG.normal(scale=1e-5, size=stamps.size), nominal=RATE, jittered=True
        )


@pytest.mark.parametrize(
    ("modulus", "step", "scale"), [(256, 1, 1.0), (0, 1, 1.0), (200, 1, 1e-6), (1000, 4, 0.1)]
)
def test_a_counter_shows_what_was_lost(modulus: int, step: int, scale: float) -> None:
    kept = lost((700, 30), (2100, 1))
    counts = step * kept
    values = scale * (counts % (step * modulus) if modulus else counts)
    base = of_rate("a", kept.size, RATE, witnesses={"emg": RNG.normal(size=kept.size), "n": values})
    assert [(gap.samples, round(gap.at * RATE)) for gap in base.gaps] == [(30, 700), (1, 2100)]
    np.testing.assert_allclose(base.times, np.arange(4000) / RATE)


@pytest.mark.parametrize("kind", ["packets of 10", "pairs", "down", "absent", "time"])
def test_counters_of_packets_down_and_with_absent_counts_show_what_was_lost(kind: str) -> None:
    kept = lost((700, 30), (2100, 20)).astype(float)
    name = {"time": "Zeit [s]"}.get(kind, "n")
    values = {
        "packets of 10": kept // 10, "pairs": kept // 2 % 201, "down": 9000 - kept,
        "absent": np.where(np.isin(np.arange(kept.size), (3, 1000, 1001)), np.nan, kept),
        "time": kept / RATE,
    }[kind]  # fmt: skip
    base = of_rate("a", kept.size, RATE, witnesses={name: values})
    assert [(gap.samples, round(gap.at * RATE)) for gap in base.gaps] == [(30, 700), (20, 2100)]


@pytest.mark.parametrize("name", ["time", "Zeit [s]", "elapsed", "unix_time", "Temps (s)", "X [s]"])
@pytest.mark.parametrize("rate", [1000.0, 1024.0])
def test_a_column_of_times_that_begins_again_contradicts_a_rate(name: str, rate: float) -> None:
    once = np.round(np.arange(2000) / rate, 6)
    columns = {name: np.r_[once, once]}
    base = of_rate("a", 4000, rate)
    base = with_counter(base, columns).noting(contradicting(columns, rate, "the rate"))
    assert not base.gaps
    (finding,) = base.findings("channel")
    assert finding.code == "counter"
    assert finding.values["at"] == pytest.approx(2000 / rate)


def test_a_column_of_times_with_absent_values_contradicts_a_rate() -> None:
    values = np.round(np.arange(1000) / 960.0, 6)
    values[5] = np.nan
    (finding,) = contradicting({"time": values}, 1000.0, "the rate")
    assert finding.code == "rate"


AMBIGUOUS = "so that the number is ambiguous"


@pytest.mark.parametrize(
    ("losses", "modulus", "total", "samples", "message"),
    [
        # more samples are lost than the counter has values: only the duration shows all of them
        ([(700, 300)], 256, None, [44], f"{AMBIGUOUS} (44 + k 256, k = 0, 1, ...)"),
        ([(700, 300)], 256, 4000, [300], "the counter 'n' and the stated duration of 4 s"),
        ([(700, 44)], 256, 4000, [44], "the counter 'n' and the stated duration of 4 s"),
        ([(700, 300), (1500, 10)], 256, None, [44, 10], f"{AMBIGUOUS} (that number + k 256"),
        ([(700, 300), (1500, 10)], 256, 4000, [44, 10], "stated duration of 4 s requires 256 more"),
        ([(700, 10), (1500, 10)], 256, 4000, [10, 10], "and the stated duration of 4 s"),
        ([(700, 300)], 256, 3900, [44], "stated duration of 3.9 s requires 156 more"),
        ([(700, 300)], 256, 3000, [44], "stated duration of 3 s requires 744 fewer"),
        # a second turn would be refused as more than a recording may lack, or none was seen
        ([(700, 300)], 10**9, None, [300], "by the counter 'n'"),
    ],
)
def test_a_counter_that_returns_does_not_hide_that_the_loss_is_ambiguous(
    losses: list[tuple[int, int]],
    modulus: int,
    total: int | None,
    samples: list[int],
    message: str,
) -> None:
    kept = lost(*losses)
    duration = None if total is None else total / RATE
    base = of_rate("a", kept.size, RATE, witnesses={"n": kept % modulus}, duration=duration)
    assert [gap.samples for gap in base.gaps] == samples
    first = base.findings("channel")[0].sentence
    assert message in first
    assert (AMBIGUOUS in first) is (AMBIGUOUS in message or "requires" in message)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "values",
    [
        np.arange(1000) * 2 // 3,
        np.repeat([0.0, 1.0], 500),
        np.cumsum(RNG.integers(0, 3, 1000)),
        np.sin(np.arange(1000)),
        np.zeros(1000),
        np.linspace(0, 1, 30),
    ],
)
def test_other_signals_are_no_counters(values: np.ndarray) -> None:
    assert counter_of(np.asarray(values, dtype=float)) is None


COUNTS = np.arange(4000)


@pytest.mark.parametrize(
    ("values", "place"),
    [
        (np.r_[COUNTS[:3000], COUNTS[:1000]], 3000),  # two recordings in one file
        (np.r_[COUNTS[:1000], COUNTS[:3000]], 1000),
        (np.r_[COUNTS[:500], COUNTS[490:3990]] % 256, 500),  # a packet stored twice
        (np.r_[COUNTS[:500], COUNTS[520:530], COUNTS[500:520], COUNTS[530:]] % 256, 510),
        (np.r_[COUNTS[:500], 499, COUNTS[500:3999]], 500),
    ],
)
def test_a_counter_that_does_not_continue_is_reported(values: np.ndarray, place: int) -> None:
    base = of_rate("a", values.size, RATE, witnesses={"n": values.astype(float)})
    assert not base.gaps
    (finding,) = base.findings("channel")
    assert finding.code == "counter"
    assert finding.values["at"] == pytest.approx(place / RATE)


def test_a_loss_may_contain_the_return_of_a_counter() -> None:
    kept = lost((500, 140))  # counts 244 to 127
    base = of_rate("a", kept.size, RATE, witnesses={"n": kept % 256})
    assert [(gap.samples, round(gap.at * RATE)) for gap in base.gaps] == [(140, 500)]


def test_single_damaged_counts_hide_no_loss() -> None:
    kept = lost((700, 30))
    values = np.where(np.arange(kept.size) == 400, 5, kept)
    base = of_rate("a", kept.size, RATE, witnesses={"n": values})
    assert [(gap.samples, round(gap.at * RATE)) for gap in base.gaps] == [(30, 700)]


@pytest.mark.parametrize("rate", [960.0, 1024.0])
def test_rounded_times_are_no_counter(rate: float) -> None:
    times = np.rint(1e3 * np.arange(4000) / rate)
    base = of_rate("a", times.size, rate, witnesses={"time [ms]": times})
    assert not base.gaps
    assert not base.findings("channel")


@pytest.mark.parametrize("step", [0.01, 0.005])
def test_times_rounded_beyond_the_period_have_no_false_gaps(step: float) -> None:
    times = np.arange(8000) / RATE
    base = of_stamps("a", step * np.rint(times / step))
    assert (base.gaps, base.rate) == ((), pytest.approx(RATE, rel=1e-4))
    kept = np.delete(times, slice(3000, 3900))
    (gap,) = of_stamps("a", step * np.rint(kept / step)).gaps
    assert (gap.after, gap.samples) == (2999, pytest.approx(900, abs=10))


def test_blocks_leave_pauses_and_overlaps_are_refused() -> None:
    base = of_blocks("a", [10.0, 11.0, 13.5], 100, 100.0, "the records")
    assert [(gap.at, gap.samples) for gap in base.gaps] == [(2.0, 150)]
    with pytest.raises(DataError, match="block 3 begins at 1.5 s"):
        of_blocks("a", [10.0, 11.0, 11.5], 100, 100.0, "the records")


def test_contradicting_statements_are_findings() -> None:
    base = of_rate(
        "a", 100, 2000.0, by="the header", others={"json": 1000.0, "tsv": 2000.0, "x": None}
    )
    (finding,) = base.findings("channel")
    assert finding.sentence.startswith("all channels: 2000 Hz by the header, but 1000 Hz by json")


def test_many_gaps_are_listed_and_counted() -> None:
    base = of_stamps("a", lost(*[(100 * k, 3) for k in range(1, 20)]) / RATE, nominal=RATE)
    codes = [finding.code for finding in base.findings("marker")]
    assert codes == ["gap_of_markers"] * 5 + ["gaps"]
    assert base.findings("marker")[-1].values["samples"] == 57
