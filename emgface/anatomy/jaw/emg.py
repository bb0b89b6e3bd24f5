"""Excitation of a jaw from surface EMG of temporalis, masseter and submental muscles.

The stages are those of the face (`emgface.signals.activation`): band-pass, amplitude feature of every
channel, normalisation by Eq. 8 of Eskes et al. 2017, combination of channels, and resampling.
"""

import warnings
from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np
import xarray as xr

from emgface.anatomy.jaw.effort import (
    at_rest,
    effort_levels,
    require_effort,
    tell_exchanged_sides,
)
from emgface.errors import FeatureWarning, JawError
from emgface.schema.validation import validate
from emgface.signals.activation import IDENTITY, emg_of, filtered_channels
from emgface.signals.envelope import muscle_activation
from emgface.signals.features import feature_of
from emgface.signals.filters import sampling_rate
from emgface.signals.normalisation import normalise
from emgface.signals.parameters import SignalChain
from emgface.signals.resampling import resample, simulation_times

JAW_CHANNELS: Final = {
    "TEM": "anterior temporalis",
    "MAS": "masseter",
    "DIG": "anterior digastric (submental electrodes)",
}
"""Electrode pairs of a side; channels are called ``TEM_L``."""

EXCITER_WEIGHTS: Final[Mapping[str, Mapping[str, float]]] = {
    "t": {"TEM": 1.0},
    "m": {"MAS": 1.0},
    "mp": {"MAS": 1.0},
    "ad": {"DIG": 1.0},
    "my": {"DIG": 1.0},
    "ip": {"DIG": 1.0},
}
"""Channels that drive the exciters of a side. Medial and lateral pterygoid cannot be recorded from the
skin. The medial pterygoid is assumed to be active with the masseter in closing, mylohyoid and
inferior lateral pterygoid with the digastric in opening."""

COUNTED: Final = 2048.0
"""Sampling rate at which the threshold of the Willison amplitude was published [Hz]."""
EXCITATION_PERIOD: Final = 5e-3
"""Sampling period of excitations [s]."""


def excitation_of(
    recording: xr.Dataset,
    chain: SignalChain | None = None,
    *,
    reference: Iterable[xr.Dataset] = (),
    weights: Mapping[str, Mapping[str, float]] = EXCITER_WEIGHTS,
) -> xr.Dataset:
    """Compute the excitation of the exciters of a jaw from one recording.

    u_e(t) = sum_c w_ec a_c(t) with the normalised features a_c of the channels of one side.

    Parameters
    ----------
    recording : xarray.Dataset
        ``emg`` (channel, time_emg) [V], with channels such as ``MAS_L``.
    chain : SignalChain, optional
        Its filter, feature and normalisation apply.
    reference : iterable of xarray.Dataset
        Recordings of maximum effort, whose range of the features normalises; by default that of the
        recording.
    weights : mapping
        Channels of every exciter, without sides.

    Returns
    -------
    xarray.Dataset
        Of schema jaw_excitation: ``excitation`` (exciter, time) [1], from time 0;
        ``recorded_start`` is that instant in the recording [s], ``passive`` lists exciters without
        channel, ``resting`` channels whose signal does not exceed noise, which have zero.

    Raises
    ------
    JawError
        No channel is known, the reference has another sampling rate although the feature counts
        samples, or does not fit (`emgface.anatomy.jaw.effort.require_effort`).
    SchemaError, UnitsError, SignalError, ActivationError
        As `emgface.signals.activation.activation_of`.
    """
    chain = chain or SignalChain()
    own = _filtered(recording, chain)
    channels, feature = [str(name) for name in own["channel"].values], _feature(own, chain)
    others = [_filtered(one, chain, channels) for one in reference]
    _require_same_rate(own, others, chain)
    _tell_rate(own, chain)
    extent = _range([_feature(one, chain) for one in others])
    if others:
        most = [effort_levels(one) for one in others]
        require_effort(channels, effort_levels(own), most)
        tell_exchanged_sides(channels, effort_levels(own), most)
        quiet = list[str]()
    else:
        quiet = at_rest(channels, effort_levels(own))
    _require_threshold(feature, extent, chain)
    normalised = normalise(feature, extent, chain.normalisation)
    normalised = normalised.where(~normalised["channel"].isin(quiet), 0.0).assign_attrs(
        normalised.attrs
    )
    above = 0.0 if extent is None else float((feature > extent["maximum"]).mean())
    if chain.feature.kind == "envelope":
        normalised = muscle_activation(normalised, chain.feature.A)
    rows, passive = dict[str, xr.DataArray](), list[str]()
    for exciter, sources in weights.items():
        for side in ("_L", "_R"):
            known = {c + side: w for c, w in sources.items() if c + side in channels}
            if len(known) < len(sources):
                passive.append(exciter + side)
                continue
            parts = [w * normalised.sel(channel=c, drop=True) for c, w in known.items()]
            rows[exciter + side] = xr.concat(parts, "part").sum("part")
    if not rows:
        raise JawError(
            "no exciter has all of its channels: record the channels of both sides, or change "
            "the weights"
        )
    u = xr.concat(list(rows.values()), "exciter").assign_coords(exciter=list(rows))
    u = u.transpose("exciter", "time").clip(0.0, 1.0)
    sampling = chain.resampling.model_copy(update={"steps": None, "period": EXCITATION_PERIOD})
    start, stop = (float(u["time"][k]) for k in (0, -1))
    u = resample(u, simulation_times(start, stop, sampling), bounded=True)
    u = u.assign_coords(
        time=("time", EXCITATION_PERIOD * np.arange(u.sizes["time"]), {"units": "s"})
    )
    u.attrs = {"units": "1", "long_name": "excitation"}
    attrs = {name: recording.attrs[name] for name in IDENTITY if name in recording.attrs}
    attrs |= {
        "recorded_start": start,
        "passive": " ".join(passive),
        "clipped_fraction": float(normalised.attrs["clipped_fraction"]),
        "exceeded_fraction": above,
        "resting": " ".join(quiet),
        "parameters": chain.model_dump_json(include={"filter", "feature", "normalisation"}),
    }
    return validate(xr.Dataset({"excitation": u}, attrs=attrs), "jaw_excitation")


def _filtered(
    recording: xr.Dataset, chain: SignalChain, channels: list[str] | None = None
) -> xr.DataArray:
    """Filtered sEMG (channel, time_emg) of the known channels, or of some that are required [V]."""
    emg = emg_of(recording)
    present = [str(name) for name in emg["channel"].values]
    known = [f"{name}{side}" for side in ("_L", "_R") for name in JAW_CHANNELS]
    chosen = [name for name in known if name in present] if channels is None else channels
    lacking = [name for name in chosen if name not in present]
    if lacking or not chosen:
        raise JawError(
            f"recording has the channels {', '.join(present) or 'none'}, expected "
            f"{', '.join(lacking or known)}: assign the labels of the file by a mapping"
        )
    filtered, _ = filtered_channels(emg.sel(channel=chosen), chain)
    return filtered


def _feature(filtered: xr.DataArray, chain: SignalChain) -> xr.DataArray:
    """Amplitude feature (channel, time)."""
    return feature_of(filtered, chain.feature, phase=chain.filter.phase)


def _require_threshold(
    feature: xr.DataArray, extent: xr.Dataset | None, chain: SignalChain
) -> None:
    """Refuse a Willison threshold that rest exceeds half as often as effort does."""
    low = feature.min("time") if extent is None else extent["minimum"]
    high = feature.max("time") if extent is None else extent["maximum"]
    lost = [str(c) for c in low["channel"].values[(low > 0.5 * high).values]]
    if chain.feature.kind == "wamp" and lost:
        raise JawError(
            "the Willison threshold is exceeded at rest more than half as often as in effort, in "
            f"{', '.join(lost)}: check the unit of the sEMG, raise the threshold, or choose "
            "the feature rms or mav"
        )


def _require_same_rate(own: xr.DataArray, others: list[xr.DataArray], chain: SignalChain) -> None:
    """Refuse references of another sampling rate for a feature that counts samples."""
    rates = [sampling_rate(one["time_emg"]) for one in (own, *others)]
    if chain.feature.kind == "wamp" and max(rates) > 1.01 * min(rates):
        raise JawError(
            f"the recording is sampled at {rates[0]:.4g} Hz and a reference at "
            f"{max(rates[1:], key=lambda r: abs(r - rates[0])):.4g} Hz, but the Willison amplitude "
            "counts samples: expected equal rates, or the feature rms or mav"
        )


def _tell_rate(own: xr.DataArray, chain: SignalChain) -> None:
    """Warn if the Willison threshold was published for another sampling rate.

    The steps of the same signal between samples grow with their interval, and exceed it more often.
    """
    rate, limit = sampling_rate(own["time_emg"]), chain.feature.threshold
    if chain.feature.kind == "wamp" and limit is not None and abs(rate / COUNTED - 1.0) > 0.1:
        steps = "larger, and exceed it" if rate < COUNTED else "smaller, and miss it"
        warnings.warn(
            f"the Willison threshold of {1e6 * limit:.3g} uV between samples was published for "
            f"{COUNTED:g} Hz, the recording is sampled at {rate:.4g} Hz, {rate / COUNTED:.2g} times as "
            f"often: steps are {steps} more often. Choose the feature rms or mav, or another threshold",
            FeatureWarning,
            stacklevel=3,
        )


def _range(features: list[xr.DataArray]) -> xr.Dataset | None:
    if not features:
        return None
    low = xr.concat([f.min("time") for f in features], "trial").min("trial")
    high = xr.concat([f.max("time") for f in features], "trial").max("trial")
    return xr.Dataset({"minimum": low, "maximum": high})
