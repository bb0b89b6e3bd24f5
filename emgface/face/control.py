"""Activation of a face as control of a simulation, with its checks."""

import warnings
from collections.abc import Iterable

import numpy as np
import xarray as xr

import sim
from emgface.errors import ActivationError, FeatureWarning, UnitsError
from emgface.face.simulation_parameters import SimulationParameters
from emgface.schema.clocks import long_and_coarse, too_slow, without_unit


def _check_units(activation: xr.DataArray) -> None:
    """Refuse other units than 1 and s, if the arrays state them."""
    for name, array, expected in (
        ("activation", activation, "1"),
        ("time of the activation", activation["time"], "s"),
    ):
        units = array.attrs.get("units", expected)
        if units != expected:
            raise UnitsError(
                f"the {name} is in {units!r}, expected {expected!r}: convert the values and set the "
                "attribute units"
            )


def seconds(time: xr.DataArray) -> np.ndarray:
    """Times of samples [s]; durations by their own unit, dates relative to the first."""
    values = time.values - time.values[:1] if time.dtype.kind == "M" else time.values
    if values.dtype.kind == "m":
        return values / np.timedelta64(1, "s")
    return np.asarray(values, dtype=np.float64)


def _times(time: xr.DataArray) -> np.ndarray:
    """Times of the samples [s], if they are ascending and their unit is known."""
    times = seconds(time)
    if len(times) < 2:
        raise ActivationError(f"the activation has {len(times)} sample, expected at least two")
    if not np.isfinite(times).all():
        at = int(np.argmin(np.isfinite(times)))
        raise ActivationError(
            f"the time of sample {at + 1} of the activation is {times[at]}, expected finite times: "
            "remove its sample"
        )
    if not (np.diff(times) > 0.0).all():
        at = int(np.argmin(np.diff(times) > 0.0))
        raise ActivationError(
            f"the time of the activation changes from t = {times[at]:.6g} s to "
            f"{times[at + 1]:.6g} s, expected ascending times: sort its samples"
        )
    if "units" not in time.attrs and time.dtype.kind not in "mM":
        if doubt := without_unit(times, "the activation"):
            raise ActivationError(doubt)
    elif too_slow(times) or long_and_coarse(times):
        warnings.warn(
            f"the activation lasts {times[-1] - times[0]:.6g} s, with an instant every "
            f"{float(np.median(np.diff(times))):.4g} s: check that its times are in seconds",
            FeatureWarning,
            stacklevel=4,
        )
    return times


def _check_spacing(times: np.ndarray) -> None:
    """Refuse samples that are not equally spaced, each of which would become one output."""
    spacing, period = np.diff(times), (times[-1] - times[0]) / (len(times) - 1)
    if (np.abs(spacing - period) > 0.1 * period).any():
        raise ActivationError(
            f"the samples of the activation are {spacing.min():.4g} to {spacing.max():.4g} s apart, "
            "expected equal intervals with timing = 'normalised', which gives one output to each: "
            "interpolate the activation at equal intervals, or choose timing = 'recorded'"
        )


def control_of(
    activation: xr.DataArray, muscles: Iterable[str], parameters: SimulationParameters
) -> tuple[sim.Activation, float, float]:
    """Activation from time 0, duration [s], and recorded time per simulated time [1]."""
    if set(activation.dims) != {"muscle", "time"}:
        raise ActivationError(
            f"the activation has the dimensions {', '.join(map(str, activation.dims))}, expected muscle "
            "and time: select one entry of every other dimension"
        )
    given, muscles = list(map(str, activation["muscle"].values)), list(map(str, muscles))
    twice = sorted({name for name in given if given.count(name) > 1})
    if twice:
        raise ActivationError(
            f"the activation contains {', '.join(twice)} more than once, expected every "
            "muscle once: remove or rename the others"
        )
    missing = [name for name in muscles if name not in given]
    unknown = [name for name in given if name not in muscles]
    if missing or unknown:
        difference = (
            (f"lacks {', '.join(missing)}")
            if missing
            else f"contains the unknown {', '.join(unknown)}"
        )
        raise ActivationError(
            f"the activation {difference}, expected exactly the muscles of the face: "
            f"{', '.join(muscles)}; for inactive others use "
            "activation.reindex(muscle=face['muscle'].values, fill_value=0)"
        )
    _check_units(activation)
    values = activation.sel(muscle=muscles).transpose("time", "muscle").values
    times = _times(activation["time"])
    every = parameters.output
    if parameters.timing == "normalised":
        _check_spacing(times)
        simulated = every * np.arange(len(times), dtype=np.float64)
        pace = float((times[-1] - times[0]) / simulated[-1])
        return sim.Activation(simulated, values), float(simulated[-1]), pace
    outputs = round((times[-1] - times[0]) / every)  # held over at most half of one at its end
    if outputs < 1:
        raise ActivationError(
            f"the activation lasts {times[-1] - times[0]:.4g} s, less than one output of {every:g} s: "
            "choose a shorter output or timing = 'normalised'"
        )
    return sim.Activation(times - times[0], values), every * outputs, 1.0
