"""Activations of recordings from their sEMG or their markers, or true ones of simulated recordings."""

import warnings
from collections.abc import Callable
from functools import cached_property

import xarray as xr

from emgface.anatomy.head.recorded import activation_of_head, has_jaw
from emgface.errors import FeatureWarning
from emgface.inverse.parameters import without_contact
from emgface.inverse.strategy import FOLDS, crossed, inverse_activation
from emgface.recordings.repeated import for_activation, stored_with
from emgface.run.digest import canonical_json, code_version, dataset_digest, text_digest
from emgface.run.store import Result
from emgface.signals.activation import activation_of
from emgface.signals.truth import TRUE_STRATEGY, true_activation_of
from emgface.study.laboratory import Setup
from emgface.study.stage_code import ACTIVATION, ACTIVATION_OF_HEAD, INVERSE, MOTION
from emgface.study.table import Recording


def activation_from_emg(
    at: Setup, recording: Recording, strategy: str, extent: Result | None
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


class ByMarkers:
    """Inversions of the recordings of a laboratory.

    `motion` simulates an activation with a label and a value of sigma_max [Pa] or None.
    """

    def __init__(
        self, laboratory: Setup, motion: Callable[[xr.DataArray, str, float | None], Result]
    ) -> None:
        self._laboratory, self._motion = laboratory, motion

    @cached_property
    def digest(self) -> str:
        """Digest of the parameters and of the code of the strategies that follow the markers."""
        chosen = self._laboratory.study.inverse.model_dump(mode="json")
        code = code_version((*INVERSE.reached, __name__))
        return text_digest(f"{canonical_json(chosen)} {code}")

    def activation(
        self,
        recording: Recording,
        strategy: str,
        extent: Result | None,
        left_out: tuple[str, ...] = (),
    ) -> Result:
        """Return the activation that follows the markers of a recording, some of them left out."""
        at = self._laboratory
        study, chosen = at.study, at.study.inverse
        inputs = {"recording": recording.digest, "face": at.face_digest}
        over = None
        if extent is not None:
            inputs["range"], over = extent.digest, extent.dataset
        simulation = without_contact(study.simulation)
        return at.store.get_or_compute(
            INVERSE,
            inputs,
            {
                "trial_strategy": strategy,
                "left_out": list(left_out),
                "inverse": chosen.model_dump(mode="json"),
                "simulation": simulation.model_dump(mode="json"),
                "signals": study.signals.model_dump(mode="json"),
            },
            lambda: inverse_activation(
                recording.dataset, at.face, simulation, study.signals, strategy, chosen, left_out,
                settled=at.rest(simulation).dataset, session=over,
            ),
            label=" ".join([recording.label, strategy, *(f"without {m}" for m in left_out)]),
        )  # fmt: skip

    def predicted(
        self,
        recording: Recording,
        strategy: str,
        label: str,
        extent: Result | None,
        sigma_max: float | None,
    ) -> Result:
        """Return a motion in which no marker is predicted from itself.

        Each pair of markers moves as simulated with the activation estimated without it.
        """
        at = self._laboratory
        drives = [self.activation(recording, strategy, extent, out) for out in FOLDS]

        def moved(limit: float | None) -> list[Result]:
            return [
                self._motion(one.dataset["activation"], f"{label} without {out[0]}", limit)
                for one, out in zip(drives, FOLDS, strict=True)
            ]

        motions = moved(sigma_max)
        used = {float(one.dataset.attrs["sigma_max"]) for one in motions}
        if len(used) > 1:
            motions = moved(min(used))
        return at.store.get_or_compute(
            MOTION,
            {f"fold_{k}": one.digest for k, one in enumerate(motions)},
            {"folds": [list(out) for out in FOLDS]},
            lambda: crossed({out: one.dataset for out, one in zip(FOLDS, motions, strict=True)}),
            label=f"{label} left-out markers",
        )
