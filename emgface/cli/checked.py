"""Result of the check of one recording, as shown by ``emgface check``."""

from collections.abc import Iterable
from dataclasses import dataclass

import pandas as pd
import xarray as xr

from analysis.tables import origin_of
from emgface.api.readiness import refusals
from emgface.cli.console import frame, out, say, show_table
from emgface.errors import DataError, EmgfaceError, listed
from emgface.recordings.check import check_recording, problems
from emgface.recordings.quality.plausible import doubtful_gains
from emgface.schema.rules import one_line
from emgface.signals.parameters import SignalChain
from emgface.study.table import samples_digest

CHECKED_COLUMNS = ("name", "signal", "rate", "duration", "unit", "finite", "longest_gap", "rms",
                   "verdict", "reason")  # fmt: skip


@dataclass(frozen=True)
class Checked:
    """Table of the channels and markers, errors, and later steps that refuse the recording."""

    file: str
    origin: str
    report: pd.DataFrame
    bad: list[str]
    refused: dict[str, str]
    volunteer: str
    samples: str  #: digest of the samples alone

    def show(self) -> None:
        """Print the table in a terminal, and one sentence for each error."""
        if out.is_terminal:
            show_table(frame(self.report[list(CHECKED_COLUMNS)]), f"{self.file} ({self.origin})")
        for sentence in self.bad:
            say(f"{self.file}: {sentence}")

    def labelled(self) -> pd.DataFrame:
        """Table with file and origin in each row."""
        table = self.report.assign(origin=self.origin)
        table.insert(0, "file", self.file)
        return table


def checked(
    file: str, recording: xr.Dataset, chain: SignalChain, study: bool, channels: str
) -> Checked:
    """Check a recording; DataError, instead of any other exception, if this is not possible.

    `study` includes missing channels and markers; `channels` is a part of the names to show.
    """
    try:
        report = check_recording(recording, study=study)
        refused = refusals(recording, chain)
    except EmgfaceError:
        raise
    except Exception as error:
        raise DataError(f"{file} could not be examined ({one_line(error)}).") from error
    if channels:
        names = report.loc[report["kind"] == "channel", "name"].astype(str)
        report = report[report["name"].isin(containing(channels, names, file))]
    volunteer = str(recording.attrs.get("volunteer", ""))
    return Checked(
        file,
        origin_of(recording),
        report,
        problems(report),
        refused,
        volunteer,
        samples_digest(recording),
    )


def later_steps(done: Iterable[Checked]) -> list[str]:
    """Sentences on later steps, each with the recordings that it would refuse for the same reason."""
    same: dict[tuple[str, str], list[str]] = {}
    for one in done:
        for refusal in one.refused.items():
            same.setdefault(refusal, []).append(one.file)
    return [
        f"{listed(files)}: 'emgface {step}' would refuse {'it' if len(files) == 1 else 'each'}: "
        f"{reason.rstrip('.')}."
        for (step, reason), files in same.items()
    ]


def gains(done: Iterable[Checked]) -> list[str]:
    """Sentences on recordings whose gain differs from that of the volunteer's other recordings."""
    measures: dict[str, dict[str, pd.DataFrame]] = {}
    for one in done:
        rows = one.report[(one.report["kind"] == "channel") & (one.report["signal"] == "EMG")]
        if one.volunteer and "floor" in rows:
            measures.setdefault(one.volunteer, {})[one.file] = rows.set_index("name")
    doubtful = (doubtful_gains(files) for files in measures.values())
    return [f"{file}: {text}." for each in doubtful for file, text in each.items()]


def copies(done: Iterable[Checked]) -> list[str]:
    """Sentences on recordings with the same samples, which a study would count as several trials."""
    same: dict[str, list[str]] = {}
    for one in done:
        same.setdefault(one.samples, []).append(one.file)
    return [
        f"{listed(files)} contain the same samples, so that one trial would count several times in a "
        "study: remove the copies."
        for files in same.values()
        if len(files) > 1
    ]


def containing(text: str, names: Iterable[str], file: str) -> list[str]:
    """Channels whose name contains a text, in any case; DataError if there is none."""
    channels = list(names)
    chosen = [name for name in channels if text.lower() in name.lower()]
    if channels and not chosen:
        raise DataError(
            f"no channel of {file} contains {text!r}, expected part of one of {', '.join(channels)}"
        )
    return chosen
