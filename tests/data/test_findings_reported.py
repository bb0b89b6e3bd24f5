"""Every finding on a recording is reported by its check, whatever it is about; names of tasks agree."""

from pathlib import Path
from string import Formatter

import numpy as np
import pytest

import emgface as ef
from emgface.recordings.bids.names import other_task
from emgface.recordings.check import check_recording, findings_of
from emgface.recordings.finding_codes import CODES
from emgface.recordings.findings import FINDING_KINDS, Finding, with_findings
from emgface.texts import json_in
from tests.data.made_recordings import noise, recording

PLACES = {"recording": [""], "channel": ["", "ZYG_R", "gone"], "marker": ["", "gone"],
          "muscle": ["", "ZYG_R"]}  # fmt: skip


GIVEN = recording(noise(4, 3.0))


def _values(code: str) -> dict[str, float | str]:
    """Values for every field of a clause: numbers where the format is one of numbers."""
    fields = ((name, form) for _, name, form, _ in Formatter().parse(CODES[code].clause) if name)
    return {name.removesuffix("!r"): 1.0 if form else "text" for name, form in fields}


@pytest.mark.parametrize("channels", [4, 0])
def test_every_code_at_every_place_reaches_the_table(channels: int) -> None:
    """Also on a channel that the recording lacks, and on a recording without any channel."""
    assert set(PLACES) == set(FINDING_KINDS)
    for kind, names in PLACES.items():
        for name in names:
            further = {"unit": "C", "type": "TEMP"}  # of signals that were left out
            every = [Finding(code, kind, name, _values(code) | further) for code in CODES]
            table = check_recording(with_findings(GIVEN.isel(channel=slice(channels)), every))
            reasons = " ".join(table["reason"])
            assert [f.code for f in every if f.clause not in reasons] == [], (kind, name)


def test_each_finding_of_a_bad_recording_is_reported() -> None:
    given = GIVEN.copy(deep=True)
    given["emg"].values[0, 100:400] = np.nan
    given["emg"].values[1] = 0.0
    reasons = " ".join(check_recording(given)["reason"])
    findings = findings_of(given)
    assert findings and all(finding.clause in reasons for finding in findings)


def test_check_lists_problems_and_warnings() -> None:
    given = GIVEN.copy(deep=True)
    given["emg"].values[0] *= 1e3
    table = ef.check(given)
    report = table["channels and markers"]
    for verdict, name in (("error", "problem"), ("warning", "warning")):
        rows = report[report["verdict"] == verdict]
        text = " ".join(table[f"{name}s"][name])
        assert len(rows) == len(table[f"{name}s"])
        assert all(reason in text for reason in rows["reason"])
    assert "check gain and unit" in " ".join(table["warnings"]["warning"])


@pytest.mark.parametrize(
    ("name", "task", "other"),
    [("Expression A", "ExpressionA", False), ("smile", "Smile", False), ("B", "A", True),
     ("n/a", "A", False), (None, "A", False), ("A+B", "A+B", False), ("!", "A", True)],
)  # fmt: skip
def test_the_label_of_a_task_follows_from_its_name(name, task, other) -> None:
    assert other_task(Path(f"sub-1_task-{task}_emg.bdf"), name) is other


@pytest.mark.parametrize("text", ['{"a": NaN}', "[Infinity]", "[1e999]", '{"a": 1, "a": 2}'])
def test_json_has_finite_numbers_and_every_name_once(text: str) -> None:
    with pytest.raises(ValueError, match="finite|twice"):
        json_in(text)
