"""True activation of a simulated recording."""

import xarray as xr

from emgface.errors import ConfigurationError
from emgface.signals.activation import check_activation
from emgface.signals.parameters import ResamplingParameters
from emgface.signals.resampling import resample, simulation_times

TRUE_STRATEGY = "true"  #: strategy name in the cube of trials driven by the true activation


def true_activation_of(recording: xr.Dataset, resampling: ResamplingParameters) -> xr.Dataset:
    """Return the true activation of a simulated recording while markers are recorded.

    The result is ``activation(muscle, time)`` [1] at the resampled times. Raises ConfigurationError
    if the recording has no ``true_activation(muscle, time_true)``.
    """
    if "true_activation" not in recording:
        raise ConfigurationError(
            "activation_source = 'true' requires recordings with true_activation, found a "
            f"{recording.attrs.get('origin', '')} one without: use 'estimated'"
        )
    truth = recording["true_activation"].rename(time_true="time")
    time, frames = truth["time"].values, recording["time_marker"].values
    start, stop = max(time[0], frames[0]), min(time[-1], frames[-1])
    times = simulation_times(float(start), float(stop), resampling)
    activation = resample(truth, times, bounded=True)
    check_activation(activation)
    keep = ("volunteer", "instruction", "repetition", "origin", "world")
    attrs = {name: recording.attrs[name] for name in keep if name in recording.attrs}
    activation.attrs = {"units": "1", "long_name": "muscle activation, true"}
    return activation.to_dataset(name="activation").assign_attrs(attrs, strategy="true")
