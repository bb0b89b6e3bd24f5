"""Activations of recordings from their sEMG, or the true ones of simulated recordings."""

import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING

import xarray as xr

from emgface.anatomy.head.recorded import activation_of_head, has_jaw
from emgface.errors import FeatureWarning
from emgface.recordings.repeated import for_activation, stored_with
from emgface.run.digest import dataset_digest
from emgface.run.store import Result
from emgface.signals.activation import activation_of
from emgface.signals.truth import TRUE_STRATEGY, true_activation_of
from emgface.study.stage_code import ACTIVATION, ACTIVATION_OF_HEAD
from emgface.study.table import Recording

if TYPE_CHECKING:
    from emgface.study.stages import Laboratory


def activation_from_emg(
    at: "Laboratory", recording: Recording, strategy: str, extent: Result | None
) -> Result:
    """Return the activation of all muscles, also of those of the jaw if a head moves.

    Recordings with a feature that is zero or saturated are added to `Laboratory.muted`.
    """
    chain = at.study.signals
    inputs, label = {"recording": recording.digest}, f"{recording.label} {strategy}"
    if strategy == TRUE_STRATEGY:
        parameters = chain.model_dump(mode="json", include={"resampling"})
        return at.store.get_or_compute(
            ACTIVATION,
            inputs,
            {"trial_strategy": strategy, **parameters},
            lambda: true_activation_of(recording.dataset, chain.resampling),
            label=label,
        )
    over = None
    if extent is not None:
        inputs["range"], over = extent.digest, extent.dataset
    parameters = chain.model_dump(mode="json", exclude={"head_frame"})
    result = at.store.get_or_compute(
        ACTIVATION,
        inputs,
        {"trial_strategy": strategy, **parameters},
        lambda: _noting_warnings(
            lambda: stored_with(
                activation_of(
                    recording.dataset, chain, strategy=strategy, session=over, reference=over
                ),
                for_activation(recording.dataset),
            )
        ),
        label=label,
    )
    head = at.head
    if head is not None and has_jaw(recording.channels):
        of_face = result
        result = at.store.get_or_compute(
            ACTIVATION_OF_HEAD,
            {"activation": of_face.digest, "recording": recording.digest, **at.moved},
            parameters,
            lambda: activation_of_head(of_face.dataset, recording.dataset, head, chain),
            label=label,
        )
    noted = result.dataset.attrs["warnings"].splitlines()
    if chain.normalisation.silent == "zero":  # muscles may be silent
        noted = [text for text in noted if " is zero in every window" not in text]
    if noted:
        at.muted.add(recording.label)
    return result


def _noting_warnings(compute: Callable[[], xr.Dataset]) -> xr.Dataset:
    """Store the warnings of features with the result instead of printing them for every trial."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", FeatureWarning)
        dataset = compute()
    for other in caught:
        if not issubclass(other.category, FeatureWarning):
            warnings.warn_explicit(other.message, other.category, other.filename, other.lineno)
    notes = [str(w.message) for w in caught if issubclass(w.category, FeatureWarning)]
    return dataset.assign_attrs(warnings="\n".join(notes))


def activation_digest(activation: xr.DataArray) -> str:
    """Digest of muscles, times and values only, so that equal activations share a simulation."""
    bare = xr.Dataset(
        {"activation": (("muscle", "time"), activation.transpose("muscle", "time").values)},
        coords={"muscle": activation["muscle"].values, "time": activation["time"].values},
    )
    return dataset_digest(bare)
