"""Activation from the sEMG of a recording, as far as it was recorded."""

import numpy as np
import xarray as xr

from emgface.errors import ConfigurationError, SchemaError, SignalError, UnitsError
from emgface.inverse.variants import Variant
from emgface.muscles import CHANNELS, MUSCLES
from emgface.signals.activation import (
    IDENTITY,
    activation_of,
    emg_of,
    feature_parameters,
    filtered_channels,
)
from emgface.signals.filters import too_large_for_semg
from emgface.signals.mapping import sources_of
from emgface.signals.montage import montage_of
from emgface.signals.parameters import SignalChain
from emgface.signals.resampling import simulation_times


def estimated_activation(
    recording: xr.Dataset, chain: SignalChain, variant: Variant, session: xr.Dataset | None
) -> xr.Dataset:
    """Activation of all muscles by act_all, 0 where none is measured.

    Channels that are absent or constant do not end the inversion: the attribute ``missing``
    contains the muscles that are computed from them. In the variant "motion", which does not use
    the sEMG, neither does a recording whose sEMG is absent or cannot be processed: the activation
    is 0 at the times of the markers, and the attribute ``montage`` states why. Other variants raise
    ConfigurationError without sEMG, the errors of `activation_of`, and UnitsError if a channel
    varies by more than sEMG can.
    """
    if "emg" not in recording and variant != "motion":
        raise ConfigurationError(
            f"the recording has no sEMG, which the variant {variant!r} needs: use the variant 'motion'"
        )
    try:
        return _estimated(recording, chain, session)
    except (SchemaError, UnitsError, SignalError) as error:
        if variant != "motion":
            raise
        frames = recording["time_marker"].values
        times = simulation_times(float(frames[0]), float(frames[-1]), chain.resampling)
        silent = np.zeros((len(MUSCLES), len(times)))
        attrs = {k: v for k, v in recording.attrs.items() if k in IDENTITY}
        return xr.Dataset(
            {"activation": (("muscle", "time"), silent, {"units": "1"})},
            coords={"muscle": list(MUSCLES), "time": ("time", times, {"units": "s"})},
            attrs=attrs
            | {"montage": f"the sEMG is not used: {error}", "missing": " ".join(MUSCLES)},
        )


def without_absent(chain: SignalChain) -> SignalChain:
    """Chain that leaves out the muscles of channels that were not recorded, in place of an error."""
    free = {
        name: "leave_out"
        for name in ("missing_side", "missing_muscle")
        if getattr(chain.montage, name) == "error"
    }
    return chain.model_copy(update={"montage": chain.montage.model_copy(update=free)})


def _estimated(recording: xr.Dataset, chain: SignalChain, session: xr.Dataset | None) -> xr.Dataset:
    emg, given = emg_of(recording), chain
    chain = without_absent(chain)
    chain = chain.model_copy(
        update={"normalisation": chain.normalisation.model_copy(update={"silent": "zero"})}
    )
    if session is not None and session.attrs.get("parameters") == feature_parameters(given):
        session = session.assign_attrs(parameters=feature_parameters(chain))
    activation = activation_of(recording, chain, strategy="act_all", session=session)
    known = emg.sel(channel=[name for name in emg["channel"].values if str(name) in CHANNELS])
    if said := too_large_for_semg(filtered_channels(known, chain)[0]):
        raise UnitsError(said)
    montage = montage_of(map(str, emg["channel"].values), chain.montage)
    silent = set(str(activation.attrs["silent"]).split()) | set(montage.zero)
    missing = [
        name
        for name in MUSCLES
        if name not in montage.estimated or silent & {name, *sources_of(name)}
    ]
    return activation.assign_attrs(missing=" ".join(missing))
