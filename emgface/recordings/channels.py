"""Power in the pass-band, median frequency and feature of each channel of a recording."""

import warnings

import numpy as np
import pandas as pd
import scipy.signal
import xarray as xr

from emgface.errors import FeatureWarning
from emgface.signals.activation import emg_of
from emgface.signals.features import feature_of
from emgface.signals.filters import TIME_EMG, bandpass, constant_rows, first_gap, sampling_rate
from emgface.signals.parameters import SignalChain


def channel_report(recording: xr.Dataset, chain: SignalChain) -> pd.DataFrame:
    """Describe every channel of a recording, for any names, in one row.

    The power spectral density of the raw signal is Welch's, with Hann segments of one second (the
    whole recording if it is shorter) overlapping by half, each without its mean. Columns are

    - ``status``: "ok", "constant", "gap of ... s at t = ... s", or, if the feature is
      uninformative, "feature zero" or "feature saturated";
    - ``rms`` [V]: of the filtered signal;
    - ``power_in_band`` [1]: fraction of the raw signal's power between the edges of the band-pass;
    - ``median_frequency`` [Hz]: halves the power between the edges;
    - ``feature_min``, ``feature_max``: in the unit ``attrs["feature_units"]``; the Willison
      amplitude counts [1], up to ``attrs["feature_full_scale"]``.

    ``attrs["pass_band"]`` are the edges [Hz] as used (`emgface.signals.filters.pass_band`). Values
    that the status leaves undefined are NaN. Raises SchemaError or UnitsError if there is no sEMG
    in volts, and SignalError if the sampling is not uniform, the rate too low for the pass-band, or
    the recording too short.
    """
    emg = emg_of(recording)
    rate = sampling_rate(emg[TIME_EMG])
    time = np.asarray(emg[TIME_EMG], dtype=float)
    names = [str(name) for name in emg["channel"].values]
    status: dict[str, str] = {}
    for name in names:
        gap = first_gap(np.asarray(emg.sel(channel=name), dtype=float))
        if gap is not None:
            status[name] = f"gap of {gap[1] / rate:.4g} s at t = {time[gap[0]]:.6g} s"
    whole = emg.sel(channel=[name for name in names if name not in status])
    status |= dict.fromkeys(constant_rows(whole), "constant") if whole.size else {}
    live = [name for name in names if name not in status]
    table = pd.DataFrame(index=pd.Index(names, name="channel"))
    table["status"] = [status.get(name, "ok") for name in names]
    columns = ("rms", "power_in_band", "median_frequency", "feature_min", "feature_max")
    table[list(columns)] = np.nan
    if not live:
        return table
    filtered = bandpass(emg.sel(channel=live), chain.filter)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FeatureWarning)  # stated by the status
        feature = feature_of(filtered, chain.feature, phase=chain.filter.phase)
    edges = filtered.attrs["filter_low"], filtered.attrs["filter_high"]
    share, median = _band_power(emg.sel(channel=live), rate, *edges)
    low, high = feature.min("time").values, feature.max("time").values
    table.loc[live, "rms"] = np.sqrt(np.mean(filtered.values**2, axis=1))
    table.loc[live, "power_in_band"] = share
    table.loc[live, "median_frequency"] = median
    table.loc[live, "feature_min"], table.loc[live, "feature_max"] = low, high
    table.attrs["feature_units"] = feature.attrs["units"]
    table.attrs["pass_band"] = edges
    if chain.feature.kind == "wamp":
        full = feature.attrs["window_samples"] - 1
        table.attrs["feature_full_scale"] = full
        for k, name in enumerate(live):
            if high[k] == 0:
                table.loc[name, "status"] = "feature zero"
            elif low[k] == full:
                table.loc[name, "status"] = "feature saturated"
    return table


def _band_power(
    emg: xr.DataArray, rate: float, low: float, high: float
) -> tuple[np.ndarray, np.ndarray]:
    """Fraction of the power between two edges, and the median frequency in this band."""
    values = np.asarray(emg.transpose("channel", TIME_EMG), dtype=float)
    segment = min(round(rate), values.shape[1])
    frequency, density = scipy.signal.welch(
        values, fs=rate, window="hann", nperseg=segment, detrend="constant", axis=1
    )
    inside = (frequency >= low) & (frequency <= high)
    within = np.cumsum(np.where(inside, density, 0.0), axis=1)
    share = within[:, -1] / density.sum(axis=1)
    median = np.array([np.interp(0.5 * row[-1], row, frequency) for row in within])
    return share, median
