"""All trials of a study in one labelled cube, none of them lost.

The cube always spans the whole product of its labels. A trial that failed stays with its status
and NaN scores; one that never came has the status "missing".
"""

import hashlib
import json
from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
import pandas as pd
import xarray as xr

from analysis.errors import CubeError
from analysis.flags import FLAGS
from analysis.trajectory import names
from analysis.trial import Origin, Trial

__all__ = ["Trial", "build_cube", "counts", "trials"]

TRIAL_DIMS: Final = ("volunteer", "instruction", "repetition", "strategy")
MARKER_DIMS: Final = (*TRIAL_DIMS, "marker")

PER_MARKER: Final = {
    "rho": ("1", "correlation of 3D trajectories"),
    "amplitude_ratio": ("1", "simulated over measured size of movement"),
    "rmse": ("m", "root-mean-square distance"),
}
OF_NOISE: Final = {
    "noise": ("m", "noise of the measured marker, three axes together"),
    "attenuation": ("1", "factor by which that noise is expected to lower rho"),
}
"""Per marker, where the noise is known."""
PER_TRIAL: Final = {
    "shift": ("s", "time added to the measured trajectory"),
    "scale": ("1", "stretch of the measured time"),
    "overlap": ("1", "fraction of simulated samples that were measured"),
    "b_correlation": ("1", "correlation of the aligned coefficient vectors"),
    "explained_variance_measured": ("1", "variance in the first component"),
    "explained_variance_simulated": ("1", "variance in the first component"),
    "direction_cosine": ("1", "cosine between the first components"),
    "sign_by_direction": ("1", "1 where the direction of the components gave their sign"),
    "unseen_ends": ("s", "time at the trial's ends at which some marker was not seen"),
    **{name: ("1", f"1 where {meaning}") for name, meaning in FLAGS.items()},
    "sigma_max": ("Pa", "maximum muscle stress that was used"),
    "steps": ("1", "time steps computed"),
    "run_time": ("s", "computing time"),
    "numerical_error": ("m", "estimated error of the time steps"),
    "motion": ("m", "largest displacement of a simulated marker"),
}
CHOICES: Final = ("form", "reference", "smallest_motion", "scaling", "scale_range", "scale_step",
                  "max_shift", "least_overlap", "least_gain", "cutoff", "sign_by", "clear_cosine",
                  "centred", "subsample", "smallest_snr")  # fmt: skip
"""Attributes of scores that all trials of a cube share."""


def build_cube(
    results: Iterable[Trial],
    *,
    volunteers: Sequence[str] | None = None,
    instructions: Sequence[str] | None = None,
    repetitions: Sequence[int] | None = None,
    strategies: Sequence[str] | None = None,
    markers: Sequence[str] | None = None,
    origin: Origin | None = None,
) -> xr.Dataset:
    """Collect the results of trials in a cube.

    Parameters
    ----------
    results : iterable of Trial
        In any order.
    volunteers, instructions, repetitions, strategies, markers : sequence, optional
        The labels expected; those found in `results` where not given (in order of appearance,
        repetitions sorted). Give them, so that trials that never came are seen to be missing.
    origin : {"measured", "simulated"}, optional
        Whether persons or a computer moved; taken from the trials where not given.

    Returns
    -------
    xarray.Dataset
        ``rho`` [1], ``amplitude_ratio`` [1], ``rmse`` [m], ``noise`` [m] of the measured marker,
        ``attenuation`` [1] of rho expected from it, and text ``marker_reason``, dims
        (volunteer, instruction, repetition, strategy, marker); per trial text ``status`` and
        ``reason``, ``shift`` [s], ``sigma_max`` [Pa], ``steps`` [1], ``run_time`` [s] and the
        rest of the alignment with its flags (`analysis.flags.FLAGS`). Attributes: ``origin`` and
        the choices common to all scores; ``environments``, JSON: what computed the trials, by the
        names that text ``computed_with`` lists per trial, beside its date ``computed``.

    Raises
    ------
    CubeError
        A label or marker that is not expected, a trial given twice, measured and simulated
        trials together, an unknown origin, or trials scored by different choices.
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
    for dim, found in labels.items():
        if not found and (dim != "marker"):
            raise CubeError(f"there is no {dim}: give at least one trial, or the labels expected")
    place = {dim: {label: i for i, label in enumerate(found)} for dim, found in labels.items()}
    shape = tuple(len(labels[dim]) for dim in TRIAL_DIMS)
    of_marker = {**PER_MARKER, **OF_NOISE}
    per_marker = {name: np.full((*shape, len(labels["marker"])), np.nan) for name in of_marker}
    per_trial = {name: np.full(shape, np.nan) for name in PER_TRIAL}
    status = np.full(shape, "missing", dtype=object)
    reason = np.full(shape, "no result was handed in", dtype=object)
    marker_reason = np.full((*shape, len(labels["marker"])), "", dtype=object)
    computed, computed_with = (np.full(shape, "", dtype=object) for _ in range(2))
    environments = {_short(text): json.loads(text) for t in trials_ for text in t.environments}
    seen: set[tuple[int, ...]] = set()
    for trial in trials_:
        index = _index(trial, place)
        if index in seen:
            raise CubeError(f"trial {trial.label} is given twice: keep one of its results")
        seen.add(index)
        status[index], reason[index] = trial.status, trial.reason
        computed[index] = trial.computed
        computed_with[index] = " ".join(sorted(map(_short, trial.environments)))
        for name in ("sigma_max", "steps", "run_time", "numerical_error", "motion", "inaccurate"):
            per_trial[name][index] = getattr(trial, name)
        if trial.scores is None:
            continue
        scores = _ordered(trial, labels["marker"])
        for name, values in per_marker.items():
            if name in scores:
                values[index] = scores[name].values
        if "reason" in scores:
            marker_reason[index] = scores["reason"].values
        for name, values in per_trial.items():
            if name in scores:
                values[index] = float(scores[name])

    cube = xr.Dataset(
        coords={
            dim: np.asarray(found, int if dim == "repetition" else str)
            for dim, found in labels.items()
        }
    )
    for name, values in per_marker.items():
        units, meaning = of_marker[name]
        cube[name] = (MARKER_DIMS, values, {"units": units, "long_name": meaning})
    cube["marker_reason"] = (
        MARKER_DIMS,
        marker_reason.astype(str),
        {"long_name": "why rho is undefined"},
    )
    cube["status"] = (
        TRIAL_DIMS,
        status.astype(str),
        {"long_name": "ok, missing, excluded, or failed"},
    )
    cube["reason"] = (
        TRIAL_DIMS,
        reason.astype(str),
        {"long_name": "why there are no scores, or what they depend on"},
    )
    told = {
        "computed": (computed, "UTC date of the last result"),
        "computed_with": (computed_with, "what computed it: keys of the attribute environments"),
    }
    for name, (values, meaning) in told.items():
        cube[name] = (TRIAL_DIMS, values.astype(str), {"long_name": meaning})
    for name, values in per_trial.items():
        units, meaning = PER_TRIAL[name]
        cube[name] = (TRIAL_DIMS, values, {"units": units, "long_name": meaning})
    cube.attrs = {"origin": _origin(trials_, origin), **_choices(trials_)}
    cube.attrs["environments"] = json.dumps(dict(sorted(environments.items())))
    return cube


def _short(environment: str) -> str:
    """Name of an environment: the first eight hexadecimal digits of its SHA-256."""
    return hashlib.sha256(environment.encode()).hexdigest()[:8]


def trials(cube: xr.Dataset) -> pd.DataFrame:
    """List every trial of a cube, whatever became of it.

    Parameters
    ----------
    cube : xarray.Dataset
        Result of `build_cube`.

    Returns
    -------
    pandas.DataFrame
        One row per trial: the labels, ``status``, ``reason``, ``median_rho``, ``n_defined`` and
        ``n_undefined`` markers (both 0 for a trial that is not ok), the values per trial, and the
        names of the ``flags`` that are raised.
    """
    stacked = cube.transpose(*MARKER_DIMS)
    rho = stacked["rho"].values.reshape(-1, stacked.sizes["marker"])
    table = pd.DataFrame(
        list(np.ndindex(*(stacked.sizes[dim] for dim in TRIAL_DIMS))), columns=list(TRIAL_DIMS)
    )
    for dim in TRIAL_DIMS:
        table[dim] = stacked[dim].values[table[dim].to_numpy()]
    table["status"] = stacked["status"].values.ravel().astype(str)
    table["reason"] = stacked["reason"].values.ravel().astype(str)
    defined = np.isfinite(rho).sum(axis=1)
    table["median_rho"] = [
        float(np.median(row[np.isfinite(row)])) if count else np.nan
        for row, count in zip(rho, defined, strict=True)
    ]
    table["n_defined"] = defined
    table["n_undefined"] = np.where(table["status"] == "ok", rho.shape[1] - defined, 0)
    for name in PER_TRIAL:
        if name in stacked:
            table[name] = stacked[name].values.ravel()
    raised = [name for name in FLAGS if name in table]
    table["flags"] = [
        ", ".join(name for name in raised if row[name] == 1.0)
        for row in table[raised].to_dict("records")
    ]
    return table


def counts(cube: xr.Dataset, *, by: Sequence[str] = ("strategy",)) -> pd.DataFrame:
    """Count the trials by what became of them.

    Parameters
    ----------
    cube : xarray.Dataset
        Result of `build_cube`.
    by : sequence of str
        Trial dims to count over; empty for the whole study.

    Returns
    -------
    pandas.DataFrame
        Index `by`; columns ``trials``, ``ok``, ``failed``, ``excluded``, ``missing`` and, in
        markers, ``correlations`` (defined) and ``undefined``. ok + failed + excluded + missing =
        trials.

    Raises
    ------
    CubeError
        `by` names something else than trial dims.
    """
    wrong = [dim for dim in by if dim not in TRIAL_DIMS]
    if wrong:
        raise CubeError(f"cannot count trials by {names(wrong)}, expected {names([*TRIAL_DIMS])}")
    table = trials(cube)
    kind = table["status"].str.split(":").str[0]
    table = table.assign(
        trials=1,
        ok=(kind == "ok").astype(int),
        failed=(kind == "failed").astype(int),
        excluded=(kind == "excluded").astype(int),
        missing=(kind == "missing").astype(int),
        correlations=table["n_defined"],
        undefined=table["n_undefined"],
    )
    columns = ["trials", "ok", "failed", "excluded", "missing", "correlations", "undefined"]
    if not by:
        return table[columns].sum().to_frame().T
    return table.groupby(list(by), sort=False)[columns].sum()


def _labels(expected: Sequence[Any] | None, found: Sequence[Any]) -> list[Any]:
    """Return the labels expected, else those found, each once in order of appearance."""
    return list(dict.fromkeys(found if expected is None else expected))


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
    found = [str(marker) for marker in trial.scores["marker"].values]
    if set(found) != set(markers) or len(found) != len(markers):
        odd = sorted(set(found) ^ set(markers)) or sorted(found)
        raise CubeError(
            f"trial {trial.label} scores other markers than the cube ({names(odd)}): "
            "score the same markers in every trial"
        )
    lacking = [name for name in PER_MARKER if name not in trial.scores]
    if lacking:
        raise CubeError(f"the scores of trial {trial.label} lack {names(lacking)}")
    return trial.scores.sel(marker=markers)


def _origin(trials_: list[Trial], origin: Origin | None) -> str:
    found = {trial.origin for trial in trials_}
    found |= {t.scores.attrs.get("origin") for t in trials_ if t.scores is not None}
    known = {str(one) for one in found if one} | ({origin} if origin else set[str]())
    if len(known) > 1:
        raise CubeError("measured and simulated trials cannot share a cube: build one of each")
    if not known or not known <= {"measured", "simulated"}:
        raise CubeError(
            f"the origin of the trials is {names(sorted(known)) or 'unknown'}, expected "
            "'measured' or 'simulated': give origin=..."
        )
    return known.pop()


def _choices(trials_: list[Trial]) -> dict[str, Any]:
    """Return the choices that all scores share; different ones cannot be compared."""
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
                    f"{chosen[name]!r}: score all trials alike"
                )
    return chosen
