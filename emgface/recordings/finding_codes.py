"""Codes of the findings about a recording, each with its severity and its clause.

Values in a clause are in SI units or without a unit; a clause states what was found and, after a
colon, what to do. A new kind of finding requires an entry here.
"""

from collections.abc import Mapping
from typing import Final, Literal, NamedTuple

Verdict = Literal["ok", "warning", "error", "not EMG"]


class Meaning(NamedTuple):
    """Severity of a code, and the clause in which the values are inserted."""

    verdict: Verdict
    clause: str


_CLOCK: Final = {
    "gap": Meaning(
        "error",
        "{samples:.0f} samples are absent for {seconds:.4g} s at t = {at:.6g} s, by {evidence}",
    ),
    "gap_of_markers": Meaning(
        "warning",
        "{samples:.0f} frames are absent for {seconds:.4g} s at t = {at:.6g} s, by {evidence}",
    ),
    "gaps": Meaning(
        "warning",
        "{count:.0f} gaps with {samples:.0f} absent samples in all, the first at t = {at:.6g} s, the "
        "longest of {seconds:.4g} s, by {evidence}",
    ),
    "rate": Meaning(
        "warning",
        "{used:.6g} Hz by {used_by}, but {other:.6g} Hz by {other_by}, a difference of {seconds:.4g} s "
        "over the recording: {used:.6g} Hz was used, check the rate",
    ),
    "reordered": Meaning(
        "warning",
        "{samples:.0f} samples were stored out of order, the first at t = {at:.6g} s: they were sorted "
        "by their times",
    ),
    "cut": Meaning(
        "warning",
        "the file ends with {line!r}, without a line end and with {why} than the lines before: it was "
        "probably cut, so that its last value may be wrong, copy or export it again",
    ),
    "sample_count": Meaning(
        "warning",
        "contains {held:.0f} samples of a channel, but its header states {stated:.0f}: lines were lost, "
        "repeated or left out, export it again",
    ),
    "repeated_line": Meaning(
        "warning",
        "line {line:.0f} of the table repeats the one before, while successive values of {cells:.0f} "
        "columns differ everywhere else: it was probably written twice, and what follows is late by one "
        "sample, export it again",
    ),
    "too_few": Meaning("error", "has {samples:.0f} samples, expected at least two"),
    "uneven": Meaning("error", "intervals differ by over {allowed:.0%}: resample the recording"),
    "no_band": Meaning(
        "error",
        "sampled at {rate:g} Hz, which contains nothing above {half:g} Hz, expected at least an octave "
        "of the pass-band from {low:g} to {high:g} Hz: record faster or choose another band",
    ),
    "slow": Meaning(
        "warning",
        "sampled at {rate:.4g} Hz, which contains nothing above {half:.4g} Hz of the 15 to 500 Hz of "
        "EMG: record faster",
    ),
    "narrow": Meaning(
        "warning",
        "sampled at {rate:.4g} Hz: the pass-band ends at {high:.4g} Hz, not {wanted:g} Hz",
    ),
    "median_frequency": Meaning(
        "warning",
        "median frequency {found:.0f} Hz over {channels:.0f} active channels at a sampling rate of "
        "{rate:g} Hz, expected {low:g} to {high:g} Hz for surface EMG: check whether the rate is too "
        "{error}",
    ),
    "no_lag": Meaning(
        "warning",
        "the table of scans states that sEMG starts at {first!r} and markers at {second!r}, which "
        "cannot be compared: they were read as if they started together, correct the table",
    ),
    "coarse_lag": Meaning(
        "warning",
        "the table of scans states that sEMG starts at {first!r} and markers at {second!r}, in whole "
        "seconds: their lag may be wrong by a second, state fractions",
    ),
    "nothing_in_common": Meaning(
        "warning",
        "sEMG from {emg_from:.4g} to {emg_to:.4g} s and markers from {marker_from:.4g} to "
        "{marker_to:.4g} s have nothing in common: check the sampling rates, and the shift of the "
        "clocks",
    ),
    "little_in_common": Meaning(
        "warning",
        "sEMG from {emg_from:.4g} to {emg_to:.4g} s and markers from {marker_from:.4g} to "
        "{marker_to:.4g} s have {common:.4g} s in common, the only part that is used: check the "
        "sampling rates, and the shift of the clocks",
    ),
}
_FLAGS: Final = {
    "bad": Meaning("error", "marked as bad in {by}{why}: treated as missing"),
    "bad_interval": Meaning(
        "error",
        "marked as bad by {by} for {seconds:.4g} s at t = {at:.6g} s: treated as a gap",
    ),
    "all_bad": Meaning(
        "error",
        "all of the {samples:.0f} samples are marked as bad by {by}: none remains, check whether this "
        "mark applies, or remove it from the file",
    ),
    "all_bad_frames": Meaning(
        "warning",
        "all of the {samples:.0f} frames are marked as bad by {by}: none remains, check whether this "
        "mark applies, or remove it from the file",
    ),
    "bad_frames": Meaning(
        "warning",
        "marked as bad by {by} for {seconds:.4g} s at t = {at:.6g} s: treated as a gap",
    ),
    "interpolated": Meaning(
        "warning",
        "{share:.0%} of the frames ({frames:.0f}) were interpolated or computed, not measured, by {by}",
    ),
    "left_out": Meaning("not EMG", "{why}"),
    "repeated_label": Meaning(
        "warning",
        "{count:.0f} signals of the file have this label, of which the first was used: give them "
        "different labels, or map each, the second by {other!r}",
    ),
    "no_repetition": Meaning(
        "warning",
        "its name contains run-{label}, but repetitions are numbered from 1: it has no repetition, "
        "specify one or rename it",
    ),
    "task": Meaning(
        "warning",
        "its name contains task-{label}, but its sidecar states TaskName {told!r}: the name was used, "
        "correct one of them",
    ),
    "instruction": Meaning(
        "warning",
        "recorded as instruction {recorded!r}, but {given!r} was specified and used: omit it, or "
        "correct the recording",
    ),
    "named_otherwise": Meaning(
        "warning",
        "its file states the {what} {recorded!r}, but its name or the mapping {given!r}, which was "
        "used: correct one of them",
    ),
    "missing": Meaning("error", "missing from the recording: {advice}"),
}
_FILLERS: Final = {
    "filler": Meaning(
        "error",
        "{samples:.0f} samples contain {filler} in place of a measurement, the longest run for "
        "{seconds:.4g} s at t = {at:.6g} s: treated as gaps",
    ),
    "filler_of_marker": Meaning(
        "warning",
        "{samples:.0f} frames contain {filler} in place of a position, the longest run for "
        "{seconds:.4g} s at t = {at:.6g} s: treated as gaps",
    ),
    "invisible": Meaning("error", "is never visible: every sample is NaN"),
    "absent_samples": Meaning(
        "error",
        "{missing:.0f} of {samples:.0f} samples are NaN, the longest gap {seconds:.4g} s: cut the "
        "trial or omit the channel",
    ),
    "lost": Meaning(
        "error", "lost for {seconds:.4g} s, longer than the {limit:g} s that are interpolated"
    ),
    "lost_briefly": Meaning("warning", "lost for up to {seconds:.4g} s, to be interpolated"),
    "ends": Meaning(
        "warning",
        "not visible for {seconds:.4g} s at the ends: the remaining part of the trial is scored",
    ),
}
_EMG: Final = {
    "constant": Meaning("error", "constant at {volts:g} V: check electrode and cable"),
    "large": Meaning("warning", "varies by {volts:.3g} V, far above EMG: check gain and unit"),
    "small": Meaning("warning", "varies by {volts:.3g} V only: check electrode, gain and unit"),
    "clipped": Meaning("warning", "{share:.1%} of samples at one extreme: clipped"),
    "rectified": Meaning(
        "warning",
        "is never negative and touches zero, which no raw EMG does: it is rectified, export the raw "
        "signal",
    ),
    "envelope": Meaning(
        "warning",
        "is never negative and {share:.0%} of its power lies below {below:g} Hz: it is an envelope or a "
        "moving average of EMG, export the raw signal",
    ),
    "prefiltered": Meaning(
        "warning",
        "its file states {what}, within the 15 to 500 Hz of EMG: amplitudes are smaller than those of "
        "other recordings, export the signal without this filter",
    ),
    "processed": Meaning(
        "warning", "its file states the filter {text!r}: it is processed, export the raw signal"
    ),
    "kind": Meaning("warning", "may be a {signal}, not EMG: {because}"),
    "hum": Meaning(
        "warning",
        "{share:.0%} of its power is mains hum of {frequency:g} Hz, {microvolts:.3g} uV: check ground "
        "and leads, or use a notch",
    ),
    "artefact": Meaning("warning", "{share:.0%} of its power lies below 15 Hz: movement artefact"),
    "drift": Meaning("warning", "drifts by {millivolts:.3g} mV: check skin and electrode"),
    "stuck": Meaning("warning", "stays at one value for {seconds:.3g} s: dropout"),
    "spikes": Meaning(
        "warning",
        "samples far from both neighbours: {count}, the first at {at:.4g} s by {microvolts:.3g} uV: "
        "damaged numbers or discharges of an electrode",
    ),
    "saturated": Meaning(
        "warning",
        "{share:.1%} of samples at the limits of the amplifier: saturated, lower the gain",
    ),
    "baseline": Meaning(
        "warning",
        "baseline {microvolts:.3g} uV: high noise, a muscle that is never at rest, or a wrong gain",
    ),
    "cross_talk": Meaning(
        "warning",
        "shares {common:.0%} of its power with {other} (r = {r:.2f}, cross-talk {share:.0%}): check the "
        "distance of the electrodes",
    ),
    "narrow_count": Meaning(
        "warning",
        "the Willison amplitude counts {low:.0f} to {high:.0f} of {most:.0f} steps: a threshold near "
        "{serves:.2g} V, twice the steps at rest, would serve",
    ),
    "weak_burst": Meaning(
        "warning",
        "the steps in activity are only {ratio:.2g} times those at rest, so that the feature consists "
        "mainly of noise and no threshold serves: a muscle at rest, or a poor electrode",
    ),
    "sides_differ": Meaning(
        "warning",
        "amplifier noise is {noise:.2g} times and activity {activity:.2g} times that of {other}, "
        "expected at most {allowed:g} times: check gain and unit of both sides",
    ),
    "sides_exchanged": Meaning(
        "warning",
        "correlates with the mouth corner of the other side (r = {r:.2f} with {other}): check whether "
        "left and right are exchanged",
    ),
}
_BELONGING: Final = {
    "other_face": Meaning(
        "warning",
        "the {what} belongs to the face {own}, but the face {used} was used: specify the face of the "
        "{what}",
    ),
    "face_unknown": Meaning(
        "warning",
        "the {what} states no digest of its face, as in files of earlier versions, so that it was not "
        "verified that it belongs to the face {used}: compute it again",
    ),
    "other_trial": Meaning(
        "warning",
        "the motion was computed from {own}, but the recording is {used}: specify the recording from "
        "which the activation was computed",
    ),
    "changed_times": Meaning(
        "warning",
        "the instants of the motion are {found:.6g} s apart, but it was simulated with an output every "
        "{output:.6g} s: its times were changed by a factor of {factor:.4g}, or it was resampled, "
        "compute it again",
    ),
    "other_times": Meaning(
        "warning",
        "the motion lasts from {motion_from:.4g} to {motion_to:.4g} s of its recording, and the {what} "
        "from {from:.4g} to {to:.4g} s, {share:.0%} of it: check the times of both, and whether the "
        "motion was computed from it",
    ),
}
_MARKERS: Final = {
    "still": Meaning("error", "does not move: check whether it is a copied frame"),
    "noise": Meaning("warning", "noise of {millimetres:.3g} mm: check calibration and light"),
    "jumps": Meaning(
        "warning", "moves at up to {speed:.3g} m/s: jumps, or a mismatch between cameras"
    ),
    "mirrored": Meaning(
        "warning", "left and right of all markers are exchanged, or the axes are mirrored"
    ),
    "misplaced": Meaning(
        "warning", "is at the position expected for {other} (misfit {ratio:.0%} when exchanged)"
    ),
    "coincides": Meaning(
        "warning",
        "is exactly at the position of {other} in {frames:.0f} frames, the first at t = {at:.6g} s: one "
        "of them was copied, or two were joined in tracking",
    ),
    "exchanged": Meaning("warning", "is exchanged with {other} at {at:.4g} s"),
    "scale": Meaning(
        "warning",
        "the markers are {found:.3g} m (rms) from their centre, expected {low:g} to {high:g} m: check "
        "the unit of the positions in the recording or its sidecar",
    ),
    "size": Meaning(
        "error",
        "the face markers are {found:.3g} m (rms) from their centre, those of a face {expected:.3g} m: "
        "check the unit of the positions in the recording or its sidecar",
    ),
}

CODES: Final[Mapping[str, Meaning]] = {
    **_CLOCK,
    **_FLAGS,
    **_FILLERS,
    **_EMG,
    **_BELONGING,
    **_MARKERS,
}
"""Meaning of every code."""
