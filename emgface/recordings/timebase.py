"""Time base of a recording: uniform instants, their evidence, and the gaps between samples.

Every reader states the instants of its samples by one of the functions of this module, which compare
all that a file says about time: a rate, other statements of the rate, time stamps, the begins of
blocks, counters. Samples that are absent become gaps (NaN) at their place, other contradictions are
findings, and what cannot be placed is refused.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from emgface.errors import DataError
from emgface.recordings.counters import LEAST_COUNTER_SAMPLES, Counter, counter_of
from emgface.recordings.findings import Finding, Kind
from emgface.recordings.stamps import (
    TIME_LABELS,
    line_through,
    places_of,
    resolution_of,
    usual_period,
)

RATE_STATEMENTS_AGREE: Final = 2e-4
"""Relative difference of two statements of a rate from which they contradict each other."""
CLOCKS_AGREE: Final = 2e-3
"""Relative difference of a rate from that of another clock from which they contradict each other."""
UNIFORM: Final = 1e-3  #: part of the period by which stored instants may differ from uniform ones
ARRIVAL: Final = 0.05  #: step back of times of arrival [s] that is regarded as jitter
#: largest distance of an instant from the uniform ones, in periods
LARGEST_JITTER_PERIODS: Final = 0.6
#: samples with gaps over samples recorded above which a file is refused
LARGEST_GROWTH: Final = 3.0
MOST_LISTED_GAPS: Final = 5  #: gaps that are described one by one
MOST_BACKWARD_STEPS: Final = 0.01  #: largest part of the steps of a column of times that lead back
#: units of a column of times that does not state it, per second
TIME_DIVISORS: Final = (1.0, 1e3, 1e6, 1e9)


@dataclass(frozen=True)
class Gap:
    """Samples that were not recorded: after which stored sample, how many, and the first's time [s]."""

    after: int
    samples: int
    at: float


@dataclass(frozen=True)
class TimeBase:
    """Instants of the samples of a signal.

    `where` is the place in messages, `times` [s] are uniform, `rate` [Hz] is theirs, `order` sorts the
    stored samples and `places` are their indices in `times`. `evidence` names what determined the
    instants.
    """

    where: str
    times: np.ndarray
    rate: float
    order: np.ndarray
    places: np.ndarray
    evidence: str
    gaps: tuple[Gap, ...] = ()
    notes: tuple[Finding, ...] = ()

    @property
    def stored(self) -> int:
        """Number of stored samples."""
        return self.order.size

    def laid(self, values: np.ndarray) -> np.ndarray:
        """Return samples (..., stored) at the instants (..., times), NaN in the gaps."""
        values = np.asarray(values, dtype=float)
        if values.shape[-1] != self.stored:
            raise DataError(
                f"{self.where} has {values.shape[-1]} samples and {self.stored} instants; expected the "
                "same number: it is damaged, export it again."
            )
        if not self.gaps and np.array_equal(self.order, self.places):
            return values
        result = np.full((*values.shape[:-1], self.times.size), np.nan)
        result[..., self.places] = values[..., self.order]
        return result

    def noting(self, notes: Sequence[Finding]) -> "TimeBase":
        """Return the same instants with further findings."""
        return replace(self, notes=(*self.notes, *notes))

    def moved(self, shift: float) -> "TimeBase":
        """Return the same instants later by `shift` [s]."""
        gaps = tuple(replace(gap, at=gap.at + shift) for gap in self.gaps)
        return replace(self, times=self.times + shift, gaps=gaps)

    def findings(self, kind: Kind) -> list[Finding]:
        """Return gaps and contradictions as findings on all channels or all markers."""
        code = "gap_of_markers" if kind == "marker" else "gap"
        result = [
            Finding(code, kind, "", {
                "at": gap.at, "samples": gap.samples, "seconds": gap.samples / self.rate,
                "evidence": self.evidence,
            })
            for gap in self.gaps[:MOST_LISTED_GAPS]
        ]  # fmt: skip
        if len(self.gaps) > MOST_LISTED_GAPS:
            most = max(self.gaps, key=lambda gap: gap.samples)
            result.append(Finding("gaps", kind, "", {
                "count": len(self.gaps), "samples": sum(gap.samples for gap in self.gaps),
                "at": self.gaps[0].at, "seconds": most.samples / self.rate,
                "evidence": self.evidence,
            }))  # fmt: skip
        return result + [replace(note, kind=kind) for note in self.notes]


def of_rate(
    where: str,
    samples: int,
    rate: float,
    *,
    first: float = 0.0,
    by: str = "the file",
    others: Mapping[str, float | None] | None = None,
    witnesses: Mapping[str, np.ndarray] | None = None,
    duration: float | None = None,
) -> TimeBase:
    """Instants of samples at a stated rate [Hz], the first at `first` [s].

    `others` are further statements of the rate by their place; those that differ are findings.
    `witnesses` are all channels (samples,) of the file, among which a counter shows lost samples, and
    `duration` [s] is that stated by the file, if any (`with_counter`).
    Raises DataError if the rate is not above 0, or a counter cannot be that of the samples.
    """
    if not (np.isfinite(rate) and 0.0 < rate < 1e9):
        raise DataError(f"{where} has the sampling rate {rate!r} Hz; expected a number above 0.")
    index = np.arange(samples)
    base = TimeBase(where, first + index / rate, rate, index, index, by)
    base = replace(base, notes=differing(rate, by, others or {}, samples))
    return with_counter(base, witnesses or {}, duration=duration)


def with_counter(
    base: TimeBase,
    channels: Mapping[str, np.ndarray],
    *,
    least: int = LEAST_COUNTER_SAMPLES,
    duration: float | None = None,
) -> TimeBase:
    """Insert the samples that a counter among the channels shows to be lost.

    A counter that returns to its beginning after m samples does not show whether k m more are lost.
    The `duration` [s] that the file states decides, if there is one gap and the duration shows a
    multiple of m; otherwise the evidence of the gaps states that their number is ambiguous. A counter
    that repeats, steps back or begins again is a finding. A column with the name of a time counts
    only if its usual step is the period of the samples, since rounded times repeat and jump.
    Without a loss, another stated duration is a finding.
    Raises DataError if more are lost than a recording may lack (`LARGEST_GROWTH`).
    """
    for name, values in channels.items():
        if values.shape != (base.stored,) or base.gaps:
            continue
        is_time = TIME_LABELS.fullmatch(name.strip()) is not None
        counter = counter_of(values, least, returns=not is_time)
        if counter is None or not (counter.lost.any() or counter.irregular.size):
            continue
        periods = [counter.step / unit * base.rate for unit in TIME_DIVISORS]
        if is_time and min(abs(p - 1.0) for p in periods) > CLOCKS_AGREE:
            continue
        if counter.irregular.size:
            after = int(counter.irregular[0])
            base = base.noting([Finding("counter", values={
                "counter": name, "places": counter.irregular.size, "at": float(base.times[after + 1]),
                "before": float(values[after]), "after": float(values[after + 1]),
            })])  # fmt: skip
            continue
        lost, evidence = _resolved(base, counter, f"the counter {name!r}", duration)
        # The step at index k is that from stored sample k to k + 1.
        steps = np.concatenate(([0], 1 + lost))
        return _placed(base, np.cumsum(steps), evidence)
    return base if duration is None or base.gaps else _lasting(base, duration)


def _lasting(base: TimeBase, duration: float) -> TimeBase:
    """Note a stated duration [s] that the samples do not have, beyond its last digit.

    Some programs state the time of the last sample.
    """
    lasts = base.times.size / base.rate
    fraction = "" if float(duration).is_integer() else repr(float(duration)).partition(".")[2]
    rounded = 0.5 * 10.0 ** -len(fraction)
    if -max(rounded, 0.5 / base.rate) <= lasts - duration <= max(rounded, 1.5 / base.rate):
        return base
    return base.noting([Finding("duration", values={"lasts": lasts, "stated": duration})])


def with_losses(base: TimeBase, losses: Mapping[int, int], evidence: str) -> TimeBase:
    """Insert the samples that a file states to be lost, by the index of the stored one they precede."""
    steps = np.ones(base.stored, dtype=np.int64)
    steps[:1] = 0
    for index, number in losses.items():
        if not (0 < index < base.stored and number > 0):
            raise DataError(
                f"{base.where}: {number} samples are lost before sample {index + 1} of {base.stored} by "
                f"{evidence}; expected a number above 0 and a stored sample: correct the markers."
            )
        steps[index] += number
    return base if base.gaps or not losses else _placed(base, np.cumsum(steps), evidence)


def _resolved(
    base: TimeBase, counter: Counter, by: str, duration: float | None
) -> tuple[np.ndarray, str]:
    """Samples lost after each by a counter and a stated duration [s], and the evidence in words."""
    cycle = round(counter.modulus / counter.step)
    total = base.stored + int(counter.lost.sum())
    if not cycle or total + cycle > LARGEST_GROWTH * base.stored:
        return counter.lost, by  # more would be refused
    places = np.flatnonzero(counter.lost)
    more = None if duration is None else round(duration * base.rate) - total
    if more is not None and more >= -1:
        turns = round(more / cycle)
        if abs(more - turns * cycle) <= 1 and (places.size == 1 or turns == 0):
            lost = counter.lost.copy()
            lost[places[0]] += turns * cycle
            return lost, f"{by} and the stated duration of {duration:g} s"
    least = "that number" if places.size > 1 else f"{counter.lost[places[0]]}"
    evidence = (
        f"{by}, which returns to its beginning after {cycle} samples, so that the number is ambiguous "
        f"({least} + k {cycle}, k = 0, 1, ...)"
    )
    if more is not None and abs(more) > 1:
        count = f"{abs(more)} {'more' if more > 0 else 'fewer'} samples"
        evidence += f", while the stated duration of {duration:g} s requires {count} in all"
    return counter.lost, evidence


def contradicting(channels: Mapping[str, np.ndarray], rate: float, by: str) -> tuple[Finding, ...]:
    """Findings on columns of times that contradict the rate [Hz] and were not chosen as its source.

    A column is one of times if its name says so and its values ascend, except at a few places, which
    are a finding; s, ms, us and ns are tried.
    """
    findings: list[Finding] = []
    for name, values in channels.items():
        if not TIME_LABELS.fullmatch(name.strip()):
            continue
        index = np.flatnonzero(np.isfinite(values))
        steps = np.diff(values[index])
        back = np.flatnonzero(steps < 0)
        if index.size < 3 or back.size > MOST_BACKWARD_STEPS * index.size:
            continue
        if back.size and counter_of(values, returns=False) is None:  # which `with_counter` reports
            after = int(index[back[0]])
            findings.append(Finding("counter", values={
                "counter": name, "places": back.size, "at": (after + 1) / rate,
                "before": float(values[after]), "after": float(values[index[back[0] + 1]]),
            }))  # fmt: skip
        span = float(values[index[-1]] - values[index[0]])
        possible = [float(index[-1] - index[0]) * unit / span for unit in TIME_DIVISORS if span > 0]
        if not back.size and possible and min(abs(p / rate - 1.0) for p in possible) > CLOCKS_AGREE:
            near = min(possible, key=lambda other: abs(np.log(other / rate)))
            place = f"the column {name!r}"
            findings += differing(rate, by, {place: near}, values.size)
    return tuple(findings)


def of_blocks(
    where: str, starts: Sequence[float] | np.ndarray, size: int, rate: float, by: str
) -> TimeBase:
    """Instants of blocks of `size` samples at a rate [Hz] that begin at stated times [s].

    A pause between two blocks is a gap. Raises DataError if blocks overlap, or the pauses are longer
    than the recording allows.
    """
    base = of_rate(where, len(starts) * size, rate, by=by)
    begin = np.asarray(starts, dtype=float) - starts[0]
    first = np.rint(begin * rate).astype(np.int64)
    early = np.flatnonzero(np.diff(first) < size)
    if early.size:
        k = int(early[0])
        raise DataError(
            f"{where}: block {k + 2} begins at {begin[k + 1]:.6g} s, {size / rate:.6g} s after block "
            f"{k + 1} at the earliest, which begins at {begin[k]:.6g} s; expected blocks one after the "
            "other: the times are wrong, export the file again."
        )
    places = (first[:, None] + np.arange(size)).ravel()
    return _placed(base, places, by)


def of_stamps(
    where: str,
    stamps: np.ndarray,
    *,
    nominal: float | None = None,
    by: str = "the times of the samples",
    nominal_by: str = "the nominal rate",
    jittered: bool = False,
    irregular: bool = False,
    largest_difference: float = float("inf"),
) -> TimeBase:
    """Instants of samples with stated times [s], compared with a nominal rate [Hz] if there is one.

    Samples stored out of order are sorted; an interval that is longer, beyond the jitter of the
    times, is a gap of lost samples; a nominal rate that the times contradict is a finding. With
    `jittered`, the times are those at which samples arrived, and the uniform instants are fitted to
    them; with `irregular`, the file states that they have no rate, so that only uniform times are
    accepted. Raises DataError, with place and size, if a time is not finite, samples share a time, the
    times are not those of uniform samples with gaps, or their rate differs from the nominal one by
    more than `largest_difference` (relative).
    """
    times = np.asarray(stamps, dtype=float).ravel()
    _require_finite(where, times)
    if times.size < 2:
        index = np.arange(times.size)
        return TimeBase(where, times, nominal or float("nan"), index, index, by)
    order = np.arange(times.size)
    notes: tuple[Finding, ...] = ()
    back = np.flatnonzero(np.diff(times) < 0)
    shared = bool((np.diff(times) == 0).all())
    period = usual_period(times) if not back.size else usual_period(np.sort(times))
    if shared or not period > 0:
        raise DataError(
            f"{where}: all {times.size} samples are at {times[0]:.6g} s; expected ascending times."
        )
    late = max(3.0 * period, ARRIVAL if jittered else 0.0)
    if back.size and float(-np.diff(times).min()) > late:
        order = np.argsort(times, kind="stable")
        moved = int((order != np.arange(times.size)).sum())
        notes = (Finding("reordered", values={"samples": moved, "at": float(times[back[0] + 1])}),)
        times = times[order]
        _require_different(where, times, period)
    nominal = nominal if nominal and np.isfinite(nominal) and nominal > 0 else None
    agree = CLOCKS_AGREE if jittered else RATE_STATEMENTS_AGREE
    if nominal and abs(period * nominal - 1.0) < CLOCKS_AGREE:
        period = 1.0 / nominal
    places = places_of(times, period)
    period, start = line_through(places, times)
    uniform = 0.1 if irregular else LARGEST_JITTER_PERIODS
    _require_near(where, times, start + period * places, period, jittered, uniform, order)
    rate = 1.0 / period
    if nominal and not abs(rate / nominal - 1.0) <= largest_difference:
        raise DataError(
            f"{where} has {rate:.6g} Hz by {by}, and {nominal:.6g} Hz by {nominal_by}; expected one "
            "rate: the rate or the times are wrong, export the file again."
        )
    if nominal:
        notes += differing(rate, by, {nominal_by: nominal}, int(places[-1]) + 1, agree)
        _require_placed(where, times, nominal, rate)
    base = TimeBase(where, times, rate, order, np.arange(times.size), by, (), notes)
    whole = bool(places[-1] == times.size - 1)
    if whole and float(np.abs(times - start - period * places).max()) <= UNIFORM * period:
        return base
    return _placed(replace(base, times=start + period * np.arange(times.size)), places, by)


def _placed(base: TimeBase, places: np.ndarray, evidence: str) -> TimeBase:
    """Return a time base whose stored samples have other places on the same uniform instants."""
    total = int(places[-1]) + 1
    if total > LARGEST_GROWTH * base.stored:
        raise DataError(
            f"{base.where} lacks {total - base.stored} samples between the {base.stored} that it "
            f"contains, by {evidence}; expected mostly samples: export each part as a separate file."
        )
    jumps = np.flatnonzero(np.diff(places) > 1)
    first = float(base.times[0])
    times = first + np.arange(total) / base.rate
    gaps = tuple(
        Gap(int(k), int(places[k + 1] - places[k] - 1), float(times[places[k] + 1])) for k in jumps
    )
    return replace(base, times=times, places=places, gaps=gaps, evidence=evidence)


def differing(
    rate: float,
    by: str,
    others: Mapping[str, float | None],
    samples: int,
    within: float = RATE_STATEMENTS_AGREE,
) -> tuple[Finding, ...]:
    """Findings on statements of the rate that contradict the one that is used."""
    findings: list[Finding] = []
    for place, other in others.items():
        if other is None or not np.isfinite(other) or other <= 0:
            continue
        seconds = abs(samples / other - samples / rate)
        if abs(other / rate - 1.0) > within:
            values = {"used_by": by, "used": rate, "other_by": place, "other": other}
            findings.append(Finding("rate", values={**values, "seconds": seconds}))
    return tuple(findings)


def _require_finite(where: str, times: np.ndarray) -> None:
    bad = np.flatnonzero(~np.isfinite(times))
    if bad.size:
        raise DataError(
            f"{where}: {bad.size} of {times.size} samples have no time, the first is sample "
            f"{bad[0] + 1}; expected a time for each: repair the times, or specify the rate instead."
        )


def _require_different(where: str, times: np.ndarray, period: float) -> None:
    """Refuse samples of two recordings that were sorted into one another."""
    near = np.flatnonzero(np.diff(times) < 0.4 * period)
    if near.size > 0.01 * times.size:
        k = int(near[0])
        raise DataError(
            f"{where}: {near.size} samples share their time with another one, the first at "
            f"{times[k]:.6g} s; expected one sample at a time: the file contains two recordings or a "
            "clock that was set back, save each part as a separate file."
        )


def _require_near(
    where: str,
    times: np.ndarray,
    uniform: np.ndarray,
    period: float,
    jittered: bool,
    uniform_within: float,
    order: np.ndarray,
) -> None:
    """Refuse times that are not uniform: away from a line by more than jitter or rounding explain."""
    away = np.abs(times - uniform)
    k = int(np.argmax(away))
    jitter = max(float((period - np.diff(times)).max()), 0.0)
    allowed = max(uniform_within * period, 0.51 * resolution_of(times))
    if jittered:
        allowed = max(allowed, 1.5 * period, 2.0 * jitter, 0.005)
    if away[k] > allowed:
        raise DataError(
            f"{where}: sample {order[k] + 1} is at {times[k]:.6g} s, {away[k]:.4g} s away from uniform "
            f"samples at {1.0 / period:.6g} Hz; expected uniform ones with gaps: resample the signal, "
            "or cut the recording there."
        )


def _require_placed(where: str, times: np.ndarray, nominal: float, rate: float) -> None:
    """Refuse losses that are spread so that no interval shows them."""
    usual = float(np.median(np.diff(times)))
    spread = abs(usual * nominal - 1.0) < CLOCKS_AGREE and rate < (1.0 - 5 * CLOCKS_AGREE) * nominal
    if spread:
        lost = round((times[-1] - times[0]) * nominal) + 1 - times.size
        raise DataError(
            f"{where}: its {times.size} samples last {times[-1] - times[0]:.6g} s, for {lost} more at "
            f"{nominal:g} Hz, but no interval shows where they are; expected all samples: it lost "
            "samples, record it again."
        )
