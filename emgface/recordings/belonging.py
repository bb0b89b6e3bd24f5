"""Findings where a result of one face or trial is used with another face, result or recording.

Results state the digest of their face (`emgface.face.identity`). Those whose file states no digest, as
of earlier versions, are compared by the name of the face, and the finding states that this is all that
was compared.
"""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import xarray as xr

from emgface.face.identity import DIGEST, FACE_ATTRIBUTE, SHOWN_DIGITS
from emgface.recordings.findings import Finding
from emgface.recordings.trial_names import TRIAL_FIELDS
from emgface.run.digest import dataset_digest

SAME_INTERVAL: Final = 1e-3  #: relative difference of intervals from which times were changed
COVERED: Final = 0.9  #: least part of a motion during which what drives it is expected to exist


def of_face(result: Mapping[str, Any], face: xr.Dataset, what: str) -> list[Finding]:
    """Finding if a result with these attributes belongs to another face, or does not state its face.

    `what` names the result, such as "motion". Results that state neither name nor digest, as positions
    that were not computed by this package, are found by "face_unknown".
    """
    name, digest = str(result.get(FACE_ATTRIBUTE, "")), str(result.get(DIGEST, ""))
    own = str(face.attrs.get("name", ""))
    if digest:
        here = dataset_digest(face)
        if digest == here:
            return []
        named = {
            "own": f"{name!r} ({digest[:SHOWN_DIGITS]})",
            "used": f"{own!r} ({here[:SHOWN_DIGITS]})",
        }
        return [Finding("other_face", values={"what": what, **named})]
    if name and own and name != own:
        return [
            Finding("other_face", values={"what": what, "own": repr(name), "used": repr(own)}),
        ]
    return [Finding("face_unknown", values={"what": what, "used": repr(own)})]


def _identity(value: object) -> str:
    """Text by which volunteers, instructions and repetitions are compared; 1, 1.0 and "01" are one.

    A volunteer "01" and one "1" of the same study differ in `emgface.study.intake`, which reads both.
    """
    text = str(value).strip()
    try:
        number = float(text)
    except ValueError:
        return text
    return str(int(number)) if number.is_integer() and abs(number) < 2**53 else text


def of_two(first: Mapping[str, Any], second: Mapping[str, Any], what: str) -> list[Finding]:
    """Finding if two results state different faces."""
    digests, names = (
        [str(one.get(key, "")) for one in (first, second)] for key in (DIGEST, FACE_ATTRIBUTE)
    )
    if all(digests) and digests[0] == digests[1]:
        return []
    if all(digests) or (all(names) and names[0] != names[1]):
        own, used = (
            f"{n!r}" + (f" ({d[:SHOWN_DIGITS]})" if d else "")
            for n, d in zip(names, digests, strict=True)
        )
        return [Finding("other_face", values={"what": what, "own": own, "used": used})]
    return [Finding("face_unknown", values={"what": what, "used": repr(names[1])})]


def of_recording(result: Mapping[str, Any], recording: Mapping[str, Any]) -> list[Finding]:
    """Finding if a motion or activation was computed from another trial than a recording.

    Both are compared by volunteer, instruction and repetition, as far as both state them, and by the
    digest of the file where they state no trial.
    """
    both = [key for key in TRIAL_FIELDS if key in result and key in recording]
    differ = [key for key in both if _identity(result[key]) != _identity(recording[key])]
    if not both and "source_digest" in result and "source_digest" in recording:
        differ = [] if result["source_digest"] == recording["source_digest"] else ["source"]
    if not differ:
        return []
    own, used = (
        ", ".join(f"{key} {one.get(key, 'unnamed')}" for key in differ)
        for one in (result, recording)
    )
    return [Finding("other_trial", values={"own": own, "used": used})]


def of_times(motion: xr.Dataset, other: xr.Dataset, dim: str, what: str) -> list[Finding]:
    """Findings if the times of a motion are not those of its simulation, or of what belongs to it.

    The interval of the instants is compared with the interval of output that the motion states, and
    the interval of the motion in its recording with the times of `other` along `dim`, called `what`:
    a recording whose markers have another rate, or an activation of another trial. A motion covers a
    part of the interval that both signals of its recording have in common, so that `other` exists
    during nearly all of it. Motions that do not state these attributes are not compared.
    """
    times = np.asarray(motion["time"].values, dtype=np.float64)
    if times.size < 3:
        return []
    findings: list[Finding] = []
    output, interval = motion.attrs.get("output"), float(np.median(np.diff(times)))
    if isinstance(output, int | float) and output > 0.0:
        factor = interval / float(output)
        if abs(factor - 1.0) > SAME_INTERVAL:
            values = {"found": interval, "output": float(output), "factor": factor}
            findings.append(Finding("changed_times", values=values))
    stated = [motion.attrs.get(name) for name in ("recorded_start", "recorded_pace")]
    if not all(isinstance(one, int | float) for one in stated) or not other.sizes.get(dim, 0):
        return findings
    begin, end = (float(stated[0] + stated[1] * t) for t in (times[0], times[-1]))
    first, last = (float(other[dim].values[k]) for k in (0, -1))
    share = (min(end, last) - max(begin, first)) / (end - begin)
    if share < COVERED:
        values = {"motion_from": begin, "motion_to": end, "what": what, "from": first, "to": last}
        findings.append(Finding("other_times", values=values | {"share": max(0.0, share)}))
    return findings
