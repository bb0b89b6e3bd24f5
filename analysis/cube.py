"""Collection of all trials of a study in one labelled cube.

The cube always spans the product of its labels. A failed trial has its status and NaN scores; a
trial without a result has the status "missing".
"""

import hashlib
import json
from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
import xarray as xr

from analysis.errors import CubeError
from analysis.flags import FLAGS
from analysis.trajectory import names
from analysis.trial import Origin, Trial

TRIAL_DIMS: Final = ("volunteer", "instruction", "repetition", "strategy")
MARKER_DIMS: Final = (*TRIAL_DIMS, "marker")

PER_MARKER: Final = {
    "rho": ("1", "correlation of 3D trajectories"),
    "amplitude_ratio": ("1", "simulated divided by measured amplitude of movement"),
    "rmse": ("m", "root-mean-square distance"),
}
OF_NOISE: Final = {
    "noise": ("m", "noise of the measured marker, three axes together"),
    "attenuation": ("1", "factor by which that noise is expected to lower rho"),
}
"""Variables per marker, if the noise is known."""
OF_INCISOR: Final = {
    "incisor_rho": ("1", "correlation of 3D trajectories of the lower incisor"),
    "incisor_amplitude_ratio": (
        "1",
        "simulated divided by measured amplitude of the lower incisor",
    ),
    "incisor_rmse": ("m", "root-mean-square distance of the lower incisor"),
}
"""Variables per trial of a study on heads."""
PER_TRIAL: Final = {
    "shift": ("s", "time added to the measured trajectory"),
    "scale": ("1", "stretch of the measured time"),
    "overlap": ("1", "fraction of simulated samples that were measured"),
    "b_correlation": ("1", "correlation of the aligned coefficient vectors"),
    "explained_variance_measured": ("1", "variance in the first component"),
    "explained_variance_simulated": ("1", "variance in the first component"),
    "direction_cosine": ("1", "cosine between the first components"),
    "sign_by_direction": ("1", "1 where the direction of the components gave their sign"),
    "unseen_ends": ("s", "time at the ends of the trial at which a marker is not visible"),
    **{name: ("1", f"1 where {meaning}") for name, meaning in FLAGS.items()},
    "sigma_max": ("Pa", "maximum muscle stress that was used"),
    "steps": ("1", "time steps computed"),
    "run_time": ("s", "computing time"),
    "numerical_error": ("m", "estimated error of the time steps, with that of contact"),
    "motion": ("m", "largest displacement of a simulated marker"),
    "reduced": ("1", "1 if a reduced face moved, 0 if full order replaced it"),
}
OF_RUN: Final = ("sigma_max", "steps", "run_time", "numerical_error", "motion", "inaccurate",
                 "reduced")  # fmt: skip
"""Members of `PER_TRIAL` that are also known for a trial without scores."""
TEXT_VARIABLES: Final = {
    "status": ("missing", "ok, missing, excluded, or failed"),
    "reason": ("no result was passed", "reason for missing scores, or remark on them"),
    "computed": ("", "UTC date of the last result"),
    "computed_with": ("", "computing environment: keys of the attribute environments"),
}
"""Text variables of a trial: value for a missing trial, and meaning."""
CHOICES: Final = ("form", "reference", "smallest_motion", "scaling", "scale_range", "scale_step",
                  "max_shift", "least_overlap", "least_gain", "cutoff", "sign_by", "clear_cosine",
                  "centred", "subsample", "smallest_snr")  # fmt: skip
"""Attributes of scores that are equal for all trials of a cube."""


def build_cube(
    results: Iterable[Trial],
    *,
    volunteers: Sequence[str] | None = None,
    instructions: Sequence[str] | None = None,
    repetitions: Sequence[int] | None = None,
    strategies: Sequence[str] | None = None,
    markers: Sequence[str] | None = None,
    origin: Origin | None = None,
    incisor: bool = False,
) -> xr.Dataset:
    """Collect the results of trials in a cube.

    Parameters
    ----------
    results : iterable of Trial
        In any order.
    volunteers, instructions, repetitions, strategies, markers : sequence, optional
        The expected labels; by default those in `results`. Specify them so that absent trials are
        listed as missing.
    origin : {"measured", "simulated"}, optional
        Origin of the recordings; by default that of the trials.
    incisor : bool
        Whether the cube has the variables `OF_INCISOR`, of trials whose scores have them.

    Returns
    -------
    xarray.Dataset
        `PER_MARKER`, `OF_NOISE` and text ``marker_reason``, dims `MARKER_DIMS`; `PER_TRIAL` and
        `TEXT_VARIABLES`, dims `TRIAL_DIMS`. Attributes: ``origin``, the choices common to all
        scores, and ``environments``, a JSON object of the computing environments by the names in
        ``computed_with``.

    Raises
    ------
    CubeError
        An unexpected label, a trial passed twice, measured and simulated trials together, an
        unknown origin, or trials scored with different choices.
    """
    trials_ = list(results)
    labels: dict[str, list[Any]] = {
        "volunteer": _labels(volunteers, [trial.volunteer for trial in trials_]),
        "instruction": _labels(instructions, [trial.instruction for trial in trials_]),
        "repetition": _labels(repetitions, sorted({int(trial.repetition) for trial in trials_})),
        "strategy": _labels(strategies, [trial.strategy for trial in trials_]),
        "marker": _labels(
            markers,
            [
                str(marker)
                for trial in trials_
                if trial.scores is not None
                for marker in trial.scores["marker"].values
            ],
        ),
    }
    for dim, entries in labels.items():
        if not entries and (dim != "marker"):
            raise CubeError(f"there is no {dim}: pass at least one trial, or the expected labels")
    cube = _empty(labels, PER_TRIAL | (OF_INCISOR if incisor else {}))
    place = {dim: {label: i for i, label in enumerate(entries)} for dim, entries in labels.items()}
    values = {str(name): cube[name].values for name in cube.data_vars}
    environments = {_short(text): json.loads(text) for t in trials_ for text in t.environments}
    seen: set[tuple[int, ...]] = set()
    for trial in trials_:
        index = _index(trial, place)
        if index in seen:
            raise CubeError(f"trial {trial.label} is passed twice: keep one of its results")
        seen.add(index)
        for name in ("status", "reason", "computed", *OF_RUN):
            values[name][index] = getattr(trial, name)
        values["computed_with"][index] = " ".join(sorted(map(_short, trial.environments)))
        if trial.scores is None:
            continue
        scores = _ordered(trial, labels["marker"])
        if "reason" in scores:
            values["marker_reason"][index] = scores["reason"].values
        for name in (*PER_MARKER, *OF_NOISE, *PER_TRIAL, *OF_INCISOR):
            if name in scores and name in values:
                values[name][index] = scores[name].values
    for name in (*TEXT_VARIABLES, "marker_reason"):
        cube[name] = cube[name].copy(data=values[name].astype(str))
    cube.attrs = {"origin": _origin(trials_, origin), **_choices(trials_)}
    cube.attrs["environments"] = json.dumps(dict(sorted(environments.items())))
    return cube


def _empty(labels: dict[str, list[Any]], per_trial: dict[str, tuple[str, str]]) -> xr.Dataset:
    """Cube of these labels in which every trial is missing; texts are objects."""
    cube = xr.Dataset(
        coords={
            dim: np.asarray(entries, int if dim == "repetition" else str)
            for dim, entries in labels.items()
        }
    )
    shape = tuple(len(entries) for entries in labels.values())
    for dims, numbers in ((MARKER_DIMS, PER_MARKER | OF_NOISE), (TRIAL_DIMS, per_trial)):
        for name, (units, meaning) in numbers.items():
            attrs = {"units": units, "long_name": meaning}
            cube[name] = (dims, np.full(shape[: len(dims)], np.nan), attrs)
    for name, (absent, meaning) in TEXT_VARIABLES.items():
        text = np.full(shape[:-1], absent, dtype=object)
        cube[name] = (TRIAL_DIMS, text, {"long_name": meaning})
    why = {"long_name": "reason for which rho is undefined"}
    return cube.assign(marker_reason=(MARKER_DIMS, np.full(shape, "", dtype=object), why))


def _short(environment: str) -> str:
    """Name of an environment: the first eight hexadecimal digits of its SHA-256."""
    return hashlib.sha256(environment.encode()).hexdigest()[:8]


def _labels(expected: Sequence[Any] | None, present: Sequence[Any]) -> list[Any]:
    """Return the expected labels, or those found, in order of appearance."""
    return list(dict.fromkeys(present if expected is None else expected))


def _index(trial: Trial, place: dict[str, dict[Any, int]]) -> tuple[int, ...]:
    index: list[int] = []
    for dim in TRIAL_DIMS:
        label = getattr(trial, dim)
        if label not in place[dim]:
            raise CubeError(
                f"trial {trial.label} has {dim} {label!r}, expected one of "
                f"{names([str(known) for known in place[dim]], most=8)}"
            )
        index.append(place[dim][label])
    return tuple(index)


def _ordered(trial: Trial, markers: list[str]) -> xr.Dataset:
    """Return the scores of a trial with the markers of the cube."""
    assert trial.scores is not None
    labels = [str(marker) for marker in trial.scores["marker"].values]
    if set(labels) != set(markers) or len(labels) != len(markers):
        odd = sorted(set(labels) ^ set(markers)) or sorted(labels)
        raise CubeError(
            f"trial {trial.label} scores other markers than the cube ({names(odd)}): "
            "score the same markers in every trial"
        )
    lacking = [name for name in PER_MARKER if name not in trial.scores]
    if lacking:
        raise CubeError(f"the scores of trial {trial.label} lack {names(lacking)}")
    return trial.scores if labels == markers else trial.scores.sel(marker=markers)


def _origin(trials_: list[Trial], origin: Origin | None) -> str:
    origins = {trial.origin for trial in trials_}
    origins |= {t.scores.attrs.get("origin") for t in trials_ if t.scores is not None}
    known = {str(one) for one in origins if one} | ({origin} if origin else set[str]())
    if len(known) > 1:
        raise CubeError("measured and simulated trials cannot share a cube: build one of each")
    if not known or not known <= {"measured", "simulated"}:
        raise CubeError(
            f"the origin of the trials is {names(sorted(known)) or 'unknown'}, expected "
            "'measured' or 'simulated': specify origin=..."
        )
    return known.pop()


def _choices(trials_: list[Trial]) -> dict[str, Any]:
    """Return the choices common to all scores; different ones cannot be compared."""
    chosen: dict[str, Any] = {}
    for trial in trials_:
        if trial.scores is None:
            continue
        for name in CHOICES:
            if name not in trial.scores.attrs:
                continue
            value = trial.scores.attrs[name]
            if not np.array_equal(chosen.setdefault(name, value), value):
                raise CubeError(
                    f"trial {trial.label} was scored with {name} = {value!r}, another one with "
                    f"{chosen[name]!r}: score all trials with the same options"
                )
    return chosen
