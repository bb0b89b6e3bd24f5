"""Steps of the signal chain as the accessor ``semg`` of xarray objects.

``recording.semg.bandpass(low=20).semg.wamp()`` computes the same as
`emgface.signals.activation.activation_of`. For a Dataset the steps use its variable ``emg``. Each
step returns a DataArray, which has the accessor again.
"""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import xarray as xr
from pydantic import BaseModel

from emgface.choices import configure
from emgface.errors import SignalError
from emgface.muscles import MUSCLES
from emgface.signals.activation import IDENTITY, emg_of
from emgface.signals.envelope import muscle_activation
from emgface.signals.features import feature_of
from emgface.signals.filters import bandpass
from emgface.signals.mapping import map_channels
from emgface.signals.normalisation import normalise
from emgface.signals.parameters import (
    FeatureParameters,
    FilterParameters,
    MappingParameters,
    NormalisationParameters,
    ResamplingParameters,
)
from emgface.signals.resampling import resample, simulation_times

StepT = TypeVar("StepT", bound=Callable[..., xr.DataArray])


def _choosing(model: type[BaseModel], *names: str) -> Callable[[StepT], StepT]:
    """Add the parameters of a model to the signature of a step, for help and completion."""

    def signed(step: StepT) -> StepT:
        from inspect import Parameter, signature

        given = signature(step)
        fixed = [p for p in given.parameters.values() if p.kind is not Parameter.VAR_KEYWORD]
        fields = model.model_fields.items()
        choices = [
            Parameter(name, Parameter.KEYWORD_ONLY, default=field.default)
            for name, field in fields
            if not names or name in names
        ]
        step.__signature__ = given.replace(parameters=[*fixed, *choices])  # pyright: ignore
        return step

    return signed


def variable_of(recording: xr.Dataset) -> xr.DataArray:
    """Return the variable ``emg``, whose accessor carries what identifies the trial."""
    array = recording["emg"]
    # The accessor that xarray would create at its first use knows the array alone.
    object.__setattr__(array, "_cache", {"semg": Steps(recording)})
    return array


class Steps:
    """Steps of the signal chain on a signal, a feature or an activation.

    Parameters
    ----------
    given : DataArray or Dataset
        Array of one time and one other dim, such as channels or muscles; for a Dataset its variable
        ``emg`` [V] is used.

    Notes
    -----
    The variable itself is ``recording.emg``, or ``recording["emg"]``.
    """

    def __init__(self, given: xr.DataArray | xr.Dataset) -> None:
        self._given = given

    @property
    def _signal(self) -> xr.DataArray:
        if isinstance(self._given, xr.DataArray):
            return self._given
        kept = {name: self._given.attrs[name] for name in IDENTITY if name in self._given.attrs}
        signal = emg_of(self._given)
        return signal.assign_attrs({**kept, **signal.attrs})

    @_choosing(FilterParameters)
    def bandpass(self, **choices: Any) -> xr.DataArray:
        """Butterworth band-pass.

        Parameters
        ----------
        **choices : Any
            ``order``, ``low`` and ``high`` [Hz], ``phase`` ("zero" or "causal"), as in the table
            ``[signals.filter]`` of a study file.

        Returns
        -------
        DataArray, dims (row, time_emg) [V]
            Filtered signal.

        Raises
        ------
        SignalError
            The signal has a gap, is too short, or its sampling rate too low.
        ConfigurationError
            A name or value of a parameter is not valid.

        Examples
        --------
        >>> import emgface, numpy as np, xarray as xr
        >>> time = np.arange(4096) / 2048
        >>> signal = xr.DataArray(
        ...     1e-4 * np.sin(2 * np.pi * 100 * time)[None],
        ...     {"channel": ["ZYG_L"], "time_emg": time},
        ...     attrs={"units": "V"},
        ... )
        >>> signal.semg.bandpass(low=20).semg.rms().sel(channel="ZYG_L").max().round(6).item()
        7.1e-05
        """
        return bandpass(self._signal, configure(FilterParameters, choices, where="bandpass"))

    @_choosing(
        FeatureParameters, "window", "label", "threshold", "threshold_baseline", "baseline_start",
        "baseline_stop", "comparison",
    )  # fmt: skip
    def wamp(self, **choices: Any) -> xr.DataArray:
        """Willison amplitude: steps between samples that reach a threshold, in a sliding window.

        Parameters
        ----------
        **choices : Any
            ``window`` [s], ``threshold`` [V], ``label``, ``comparison``; or ``threshold_baseline``
            with ``baseline_start`` and ``baseline_stop`` [s].

        Returns
        -------
        DataArray, dims (row, time) [1]
            Counts.

        Raises
        ------
        SignalError, ConfigurationError
            As `bandpass`.
        """
        return self._feature("wamp", choices)

    @_choosing(FeatureParameters, "window", "label")
    def rms(self, **choices: Any) -> xr.DataArray:
        """Root mean square of a sliding window [V]; ``window`` [s] and ``label``, as `wamp`."""
        return self._feature("rms", choices)

    @_choosing(FeatureParameters, "window", "label")
    def mav(self, **choices: Any) -> xr.DataArray:
        """Mean absolute value of a sliding window [V]; ``window`` [s] and ``label``, as `wamp`."""
        return self._feature("mav", choices)

    @_choosing(FeatureParameters, "envelope_cutoff", "envelope_order", "delay", "C1", "C2")
    def envelope(self, **choices: Any) -> xr.DataArray:
        """Linear envelope with the transfer function from neural to muscle activation.

        Parameters
        ----------
        **choices : Any
            ``envelope_cutoff`` [Hz], ``envelope_order``, ``delay`` [s], ``C1``, ``C2`` [1].

        Returns
        -------
        DataArray, dims (row, time) [V]
            Neural activation before normalisation; `shape` follows `normalise`.

        Raises
        ------
        SignalError, ConfigurationError
            As `bandpass`.
        """
        return self._feature("envelope", choices)

    @_choosing(MappingParameters, "oom")
    def muscles(self, names: Sequence[str] = MUSCLES, **choices: Any) -> xr.DataArray:
        """Combine the measured channels into the modelled muscles (Eskes et al. 2017, Eqs 2-6).

        Parameters
        ----------
        names : sequence of str
            Muscles to compute, if a recording contains the channels of some only.
        **choices : Any
            ``oom``: "text" or "as_printed", the reading of Eq. 3.

        Returns
        -------
        DataArray, dims (muscle, time)
            The same quantity of the muscles.

        Raises
        ------
        SchemaError
            No channel of a muscle exists.
        """
        chosen = configure(MappingParameters, choices, where="muscles")
        return map_channels(self._signal, chosen.oom, names)

    @_choosing(NormalisationParameters, "silent", "resting", "outside")
    def normalise(self, extent: xr.Dataset | None = None, **choices: Any) -> xr.DataArray:
        """Min-max normalisation to 0-1 (Eskes et al. 2017, Eq. 8).

        Parameters
        ----------
        extent : Dataset, optional
            Range of a session or of a reference (`emgface.signals.activation.feature_range`); that
            of this feature when absent.
        **choices : Any
            ``silent``, ``resting``, ``outside``, as in the table ``[signals.normalisation]``.

        Returns
        -------
        DataArray, dims (row, time) [1]
            Between 0 and 1.

        Raises
        ------
        SignalError, ActivationError
            A feature is constant, or leaves the range.
        """
        chosen = configure(NormalisationParameters, choices, where="normalise")
        return normalise(self._signal, extent, chosen)

    def shape(self, A: float = FeatureParameters().A) -> xr.DataArray:
        """Nonlinear shape of a normalised `envelope` [1], (exp(A u) - 1) / (exp(A) - 1)."""
        return muscle_activation(self._signal, A)

    @_choosing(ResamplingParameters)
    def resample(self, **choices: Any) -> xr.DataArray:
        """Sample a feature or an activation at equal intervals, within its own time range.

        Parameters
        ----------
        **choices : Any
            ``steps`` [1] from the first to the last instant, or ``period`` [s].

        Returns
        -------
        DataArray, dims (row, time)
            Resampled.

        Raises
        ------
        SignalError
            The data have gaps or are too short.
        """
        signal = self._signal
        if "time" not in signal.dims:
            raise SignalError(
                f"found dims {tuple(signal.dims)}, expected a feature over 'time': compute one first"
            )
        chosen = configure(ResamplingParameters, choices, where="resample")
        first, last = (float(signal["time"][k]) for k in (0, -1))
        return resample(signal, simulation_times(first, last, chosen), bounded=True)

    def _feature(self, kind: str, choices: dict[str, Any]) -> xr.DataArray:
        """Compute one feature; the phase of an envelope follows that of the band-pass."""
        signal = self._signal
        chosen = configure(FeatureParameters, {**choices, "kind": kind}, where=kind)
        return feature_of(signal, chosen, phase=signal.attrs.get("filter_phase", "zero"))

    def __repr__(self) -> str:
        """List the steps and show the signal."""
        steps = [name for name in vars(type(self)) if not name.startswith("_")]
        return f"Steps of the signal chain: {', '.join(steps)}\n{self._signal!r}"
