"""Activations that follow the markers of recordings, and motions of markers that were left out."""

from functools import cached_property
from typing import TYPE_CHECKING

from emgface.inverse.parameters import without_contact
from emgface.inverse.strategy import FOLDS, crossed, inverse_activation
from emgface.run.digest import canonical_json, code_version, text_digest
from emgface.run.store import Result
from emgface.study.stage_code import INVERSE, MOTION
from emgface.study.table import Recording

if TYPE_CHECKING:
    from emgface.study.stages import Laboratory


class ByMarkers:
    """Inversions of the recordings of a laboratory."""

    def __init__(self, laboratory: "Laboratory") -> None:
        self._laboratory = laboratory

    @cached_property
    def digest(self) -> str:
        """Digest of the parameters and of the code of the strategies that follow the markers."""
        chosen = self._laboratory.study.inverse.model_dump(mode="json")
        code = code_version((*INVERSE.modules, __name__))
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
                at.motion(one.dataset["activation"], f"{label} without {out[0]}", limit)
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
