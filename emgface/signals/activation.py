"""Activations of the twenty muscles of the face model from a recording.

The order of the stages is determined by `mapping_stage`:

========== =====================================================================
signal     filter, Eqs 2-6, feature, Eq. 8 per muscle, strategy, resampling
feature    filter, feature, Eqs 2-6, Eq. 8 per muscle, strategy, resampling
activation filter, feature, Eq. 8 per channel, Eqs 2-6, strategy, resampling
========== =====================================================================

If minimum and maximum of Eq. 8 are those of a session or of maximum-effort recordings,
`feature_range` computes them once for all trials.
"""

import json
import warnings
from collections.abc import Iterable
from typing import Any, Final, Literal

import numpy as np
import xarray as xr

from emgface.errors import (
    ActivationError,
    ConfigurationError,
    FeatureWarning,
    SchemaError,
    SignalError,
    UnitsError,
)
from emgface.muscles import CHANNELS, MUSCLES
from emgface.recordings.findings import ATTRIBUTE, Finding, findings_in, with_findings
from emgface.signals.doubtful import doubtful_rows, little_in_common
from emgface.signals.envelope import muscle_activation
from emgface.signals.features import feature_of
from emgface.signals.filters import (
    TIME_EMG,
    bandpass,
    constant_rows,
    pass_band,
    row_dim,
    sampling_rate,
    too_large_for_semg,
)
from emgface.signals.mapping import map_channels, sources_of
from emgface.signals.montage import Montage, montage_of, with_mirrored
from emgface.signals.normalisation import normalise
from emgface.signals.parameters import SignalChain
from emgface.signals.resampling import resample, simulation_times
from emgface.signals.strategies import needed_muscles, select_muscles


def activation_of(
    recording: xr.Dataset,
    chain: SignalChain,
    *,
    strategy: str | None = None,
    instruction: str | None = None,
    session: xr.Dataset | None = None,
    reference: xr.Dataset | None = None,
) -> xr.Dataset:
    """Compute the activation of every muscle from one recording (Eskes et al. 2017, Eqs 2-8).

    `recording` contains ``emg`` (channel, time_emg) [V]. `strategy` and `instruction` (A to F,
    required by act_rel) default to the chain's strategy and the recording's attribute. `session`
    and `reference` are the `feature_range` of all trials of the volunteer or of the maximum-effort
    recordings, required if the normalisation refers to them.

    The result contains ``activation`` (muscle, time) [1] within 0-1, zero for muscles that are not
    selected. Time [s] is that of the recording, over the interval in which the feature (and the
    markers, if recorded) exist. Its attributes identify the trial and state strategy, ``selected``
    muscles (without side), ``silent``, ``resting``, ``clipped_fraction``, ``montage``, the settings
    of filter and feature, ``parameters`` (JSON), and ``findings`` on selected muscles whose feature
    counts few steps or is mainly noise (`emgface.signals.doubtful`).

    Raises SchemaError or UnitsError if there is no sEMG in V or a required muscle lacks its channel
    and a treatment of it; SignalError if a signal cannot be processed (gap, constant, too short,
    low rate); ConfigurationError if strategy, instruction or range do not fit the chain;
    ActivationError if an activation leaves 0-1 or is not finite.
    """
    strategy = chain.strategy.name if strategy is None else strategy
    recorded_as = recording.attrs.get("instruction")
    instruction = recorded_as if instruction is None else _instruction(instruction)
    montage = montage_of(map(str, emg_of(recording)["channel"].values), chain.montage)
    montage.demand(needed_muscles(strategy, instruction), strategy)
    feature, silent = feature_before_normalisation(recording, chain)
    doubts = findings_in(feature)
    extent = _extent_for(recording, chain, feature, session, reference)
    normalised = normalise(feature, extent, chain.normalisation)
    doubts += [*findings_in(normalised), *_of_other_channels(feature, montage, extent)]
    if chain.feature.kind == "envelope":
        normalised = muscle_activation(normalised, chain.feature.A)
    if chain.mapping.mapping_stage == "activation":
        normalised = map_channels(normalised, chain.mapping.oom, montage.estimated)
        feature = map_channels(feature, chain.mapping.oom, montage.estimated)
    selected = select_muscles(feature, strategy, instruction, chain.strategy)
    doubts = [one for one in doubts if one.kind != "muscle" or one.name[:-2] in selected]
    if recorded_as is not None and instruction != recorded_as:
        values = {"given": str(instruction), "recorded": str(recorded_as)}
        doubts.append(Finding("instruction", values=values))
    on = [str(name).rsplit("_", 1)[0] in selected for name in normalised["muscle"].values]
    activation = normalised * xr.DataArray(np.array(on, dtype=float), dims="muscle")
    activation.attrs = {**normalised.attrs, "units": "1"}
    times = simulation_times(*_common_interval(activation, recording), chain.resampling)
    activation = resample(activation, times, bounded=True)
    check_activation(activation)
    activation = activation.reindex(muscle=list(MUSCLES)).fillna(0.0)  # the others stay passive
    activation["muscle"].attrs.clear()
    recorded = _storable(activation.attrs)
    activation.attrs = {"units": "1", "long_name": "muscle activation"}
    attrs = {
        **{k: v for k, v in recorded.items() if k != ATTRIBUTE},
        **{k: v for k, v in recording.attrs.items() if k in IDENTITY},
        "strategy": strategy,
        "selected": " ".join(selected),
        "montage": montage.sentence,
        "silent": " ".join(sorted({*silent, *recorded.get("silent", "").split()})),
        "parameters": chain.model_dump_json(),
    }
    if instruction is not None:
        attrs["instruction"] = instruction
    return with_findings(activation.rename("activation").to_dataset().assign_attrs(attrs), doubts)


def _instruction(given: object) -> str:
    """Return an instruction that was specified; ConfigurationError unless it is a text."""
    if not isinstance(given, str) or not given.strip():
        raise ConfigurationError(
            f"the instruction is {given!r}, expected its letter, such as 'A': specify it, or omit it to "
            "use that of the recording"
        )
    return given


#: relative difference of sampling rates below which features can be compared
FEATURE_RATES_AGREE = 2e-3
IDENTITY = (
    "volunteer", "instruction", "repetition", "origin", "world", "source", "source_digest",
)  # fmt: skip


def feature_before_normalisation(
    recording: xr.Dataset, chain: SignalChain
) -> tuple[xr.DataArray, tuple[str, ...]]:
    """Filter, map and compute the feature, up to the quantity that Eq. 8 normalises.

    Returns the feature (muscle, time), or (channel, time) if mapping_stage is "activation", of the
    muscles that the montage allows to estimate, and the names of channels with a constant value.
    Raises SchemaError, UnitsError and SignalError as `activation_of`.
    """
    emg = emg_of(recording)
    montage = montage_of(map(str, emg["channel"].values), chain.montage)
    emg = with_mirrored(emg, montage)
    filtered, silent = filtered_channels(emg, chain)
    if said := too_large_for_semg(filtered):
        warnings.warn(said, FeatureWarning, stacklevel=2)
    oom, stage = chain.mapping.oom, chain.mapping.mapping_stage
    if stage == "signal":
        filtered = map_channels(filtered, oom, montage.estimated)
    feature = feature_of(filtered, chain.feature, phase=chain.filter.phase)
    feature = with_findings(feature, doubtful_rows(feature, filtered))
    if stage == "feature":
        feature = map_channels(feature, oom, montage.estimated)
    return feature, silent


def filtered_channels(
    emg: xr.DataArray, chain: SignalChain
) -> tuple[xr.DataArray, tuple[str, ...]]:
    """Filtered sEMG, zero where a channel has a constant value, and the names of these channels.

    Raises SignalError if there is one and the normalisation does not choose silent = "zero".
    """
    silent = constant_rows(emg)
    if silent and chain.normalisation.silent == "error":
        raise SignalError(
            f"{'channels' if len(silent) > 1 else 'channel'} {', '.join(silent)} "
            f"{'hold' if len(silent) > 1 else 'holds'} one value throughout, so that Eq. 8 "
            "would be 0/0: check the electrode, or choose silent = 'zero' for activation 0"
        )
    filtered = bandpass(emg, chain.filter)
    # A filtered constant consists of rounding noise, which Eq. 8 would amplify to 0-1.
    return filtered.where(~filtered["channel"].isin(silent), 0.0), silent


def emg_of(recording: xr.Dataset) -> xr.DataArray:
    """Return the variable ``emg`` (channel, time_emg) [V] of a recording.

    Raises SchemaError if there is no sEMG or no sample of it, and UnitsError if its unit is not V.
    """
    if "emg" not in recording or "channel" not in recording["emg"].coords:
        raise SchemaError(
            f"recording contains {', '.join(map(str, recording.data_vars)) or 'no variable'}, expected"
            " emg (channel, time_emg) with named channels: check the reader's mapping"
        )
    units = recording["emg"].attrs.get("units")
    if not recording["emg"].size:
        raise SchemaError("the sEMG of the recording has no samples, expected some: read it again")
    if units != "V":
        raise UnitsError(
            f"emg has units {units!r}, expected 'V': convert the recording when it is read"
        )
    return recording["emg"]


def feature_range(recordings: Iterable[xr.Dataset], chain: SignalChain) -> xr.Dataset:
    """Compute minimum and maximum of the feature over a set of recordings, for Eq. 8.

    `recordings` are all trials of a volunteer (reach "session") or maximum-effort recordings, which
    should include some rest (reach "reference"); they are read one at a time. The result contains
    ``minimum`` and ``maximum`` over muscle (over channel if mapping_stage is "activation"), in the
    unit of the feature, with the attributes volunteer, recordings (their number), sampling_rate [Hz],
    parameters (JSON of the stages that determine the feature) and ``channels_behind``. The range of a
    muscle is that of the recordings with most of its own channels: a copy of the other side, or a
    muscle of two channels of which one is missing, has another amplitude. Raises SignalError,
    SchemaError or UnitsError if there is no recording, one cannot be processed, or their sampling
    rates give different features, and ConfigurationError if they are of different volunteers.
    """
    volunteers: list[str] = []
    rates: list[float] = []
    rows: dict[str, dict[tuple[str, ...], list[tuple[float, float]]]] = {}
    dim = units = ""
    for recording in recordings:
        rates.append(sampling_rate(emg_of(recording)[TIME_EMG]))
        _require_one_rate(rates[0], rates[-1], chain, "recordings of the range")
        feature, _ = feature_before_normalisation(recording, chain)
        montage = montage_of(map(str, recording["channel"].values), chain.montage)
        dim, units = row_dim(feature, "time"), str(feature.attrs["units"])
        for name, row in zip(map(str, feature[dim].values), feature.values, strict=True):
            extremes = float(row.min()), float(row.max())
            rows.setdefault(name, {}).setdefault(montage.channels_behind(name), []).append(extremes)
        volunteers.append(str(recording.attrs.get("volunteer", "")))
    if not rows:
        raise SignalError(
            "no recording specified for the minimum and maximum, expected at least one: list the "
            "session's trials or the reference recordings"
        )
    if len(set(volunteers)) > 1:
        raise ConfigurationError(
            f"recordings of several volunteers ({', '.join(sorted(set(volunteers)))}) cannot share "
            "one normalisation: compute one range per volunteer"
        )
    behind = {name: _most_of_its_own(name, list(sets)) for name, sets in rows.items()}
    extremes = [np.array(rows[name][channels]) for name, channels in behind.items()]
    data = {"minimum": [one.min() for one in extremes], "maximum": [one.max() for one in extremes]}
    return xr.Dataset(
        {name: (dim, values, {"units": units}) for name, values in data.items()},
        coords={dim: list(rows)},
        attrs={
            "volunteer": volunteers[0],
            "recordings": len(volunteers),
            "sampling_rate": rates[0],
            "parameters": feature_parameters(chain),
            CHANNELS_BEHIND: json.dumps({name: " ".join(c) for name, c in behind.items()}),
        },
    )


CHANNELS_BEHIND: Final = "channels_behind"
"""Attribute of a range: channels from which each row was computed, as JSON."""


def _most_of_its_own(name: str, sets: list[tuple[str, ...]]) -> tuple[str, ...]:
    """Of the sets of channels that recordings have for a row, the one with most of the row's own."""
    own = {name} if name in CHANNELS else set(sources_of(name))
    return max(sets, key=lambda channels: len(own & set(channels)))


def _of_other_channels(
    feature: xr.DataArray, montage: Montage, extent: xr.Dataset | None
) -> list[Finding]:
    """Findings on rows whose range was computed from other channels than the recording has."""
    if (
        extent is None or CHANNELS_BEHIND not in extent.attrs
    ):  # absent in ranges of earlier versions
        return []
    dim = row_dim(feature, "time")
    stored = json.loads(extent.attrs[CHANNELS_BEHIND])
    pairs = (
        (name, " ".join(montage.channels_behind(name)), str(stored[name]))
        for name in map(str, feature[dim].values)
    )
    kind = "muscle" if dim == "muscle" else "channel"
    return [
        Finding("other_channels", kind, name, {"own": own, "of_range": of_range})
        for name, own, of_range in pairs
        if own != of_range
    ]


def check_activation(activation: xr.DataArray) -> None:
    """Raise ActivationError unless all activations (muscle, time) are finite and within 0-1."""
    a = activation.transpose("muscle", "time")
    # Written so that NaN fails too.
    bad = ~((a.values >= 0.0) & (a.values <= 1.0))
    if bad.any():
        k, j = np.argwhere(bad)[0]
        raise ActivationError(
            f"activation of muscle {a['muscle'].values[k]} is {a.values[k, j]:.6g} at t = "
            f"{float(a['time'][j]):.6g} s, expected a finite value between 0 and 1: normalise or "
            "clip it"
        )


def _extent_for(
    recording: xr.Dataset,
    chain: SignalChain,
    feature: xr.DataArray,
    session: xr.Dataset | None,
    reference: xr.Dataset | None,
) -> xr.Dataset | None:
    """Return the range specified by the chain, after checking that it matches the recording."""
    reach: Literal["trial", "session", "reference"] = chain.normalisation.reach
    if reach == "trial":
        return None
    extent = session if reach == "session" else reference
    if extent is None:
        raise ConfigurationError(
            f"normalisation over the {reach} requires its minimum and maximum, found none: compute "
            f"them with feature_range and pass them as {reach}="
        )
    if not isinstance(extent, xr.Dataset) or not {"minimum", "maximum"} <= set(extent):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ConfigurationError(
            f"the range of the {reach} is of type {type(extent).__name__}, expected a Dataset with "
            "minimum and maximum: compute it with feature_range"
        )
    if extent.attrs.get("parameters") != feature_parameters(chain):
        raise ConfigurationError(
            f"range of the {reach} was computed with filter, feature or mapping parameters "
            "that differ from those of this chain: compute it again with feature_range"
        )
    dim = "muscle" if "muscle" in feature.dims else "channel"
    lacking = sorted(set(feature[dim].values.tolist()) - set(extent[dim].values.tolist()))
    if lacking:
        raise ConfigurationError(
            f"range of the {reach} contains no {dim} {', '.join(lacking)}, expected all of the trial's: "
            f"record the {reach} with the same channels"
        )
    if "sampling_rate" in extent.attrs:  # absent in ranges of earlier versions
        rate = sampling_rate(emg_of(recording)[TIME_EMG])
        of_range = float(extent.attrs["sampling_rate"])
        _require_one_rate(of_range, rate, chain, f"range of the {reach} and the recording")
    volunteer = str(recording.attrs.get("volunteer", ""))
    if extent.attrs.get("volunteer", "") != volunteer:
        raise ConfigurationError(
            f"range of the {reach} is of volunteer '{extent.attrs.get('volunteer', '')}', the "
            f"recording of '{volunteer}': pass the range of the same volunteer"
        )
    return extent


def _require_one_rate(one: float, other: float, chain: SignalChain, what: str) -> None:
    """Refuse sampling rates [Hz] whose features cannot be compared.

    The Willison amplitude counts steps from sample to sample, and therefore depends on the rate; the
    other features depend on it if it narrows the pass-band.
    """
    if abs(other / one - 1.0) <= FEATURE_RATES_AGREE:
        return
    bands = {pass_band(chain.filter, rate) for rate in (one, other)}
    if chain.feature.kind != "wamp" and len(bands) == 1:
        return
    raise SignalError(
        f"the {what} are sampled at {one:g} and {other:g} Hz, at which the {chain.feature.kind} "
        "feature differs; expected one rate: resample the faster one, or normalise over the trial"
    )


def feature_parameters(chain: SignalChain) -> str:
    """JSON of the stages that determine the feature before normalisation."""
    return chain.model_dump_json(include={"filter", "feature", "mapping", "montage"})


def _common_interval(activation: xr.DataArray, recording: xr.Dataset) -> tuple[float, float]:
    """Interval in which activation and, if recorded, markers exist.

    Warns if much of sEMG or markers lies outside of it (`little_in_common`).
    """
    start, stop = float(activation["time"][0]), float(activation["time"][-1])
    if "time_marker" not in recording.coords:
        return start, stop
    for finding in little_in_common(recording):
        warnings.warn(finding.clause, FeatureWarning, stacklevel=3)
    time = recording["time_marker"]
    return max(start, float(time[0])), min(stop, float(time[-1]))


def _storable(attrs: dict[Any, Any]) -> dict[str, Any]:
    """Attributes of the chain without the unit of its last quantity."""
    return {str(k): v for k, v in attrs.items() if k not in ("units", "long_name")}
