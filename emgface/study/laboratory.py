"""What the trials of a study share: store, face or head, configuration, range and rest."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import xarray as xr

from emgface.anatomy.head.model import Head
from emgface.face.motion import of_rest, settle_face
from emgface.face.simulation_parameters import SimulationParameters
from emgface.run.digest import dataset_digest, file_digest
from emgface.run.store import Result, Store
from emgface.signals.activation import feature_range
from emgface.study.configuration import StudyConfiguration
from emgface.study.file import study_face, study_head, volunteer_faces
from emgface.study.stage_code import RANGE, REST


@dataclass
class Setup:
    """Data common to the trials of a study: store, face, configuration.

    `report` receives one sentence for the reader; `muted` collects recordings with a feature that
    is zero or saturated for at least one muscle. `own` contains the faces of the volunteers if each
    has one; `face` is then the first of them.
    """

    store: Store
    face: xr.Dataset
    study: StudyConfiguration
    report: Callable[[str], None]
    muted: set[str] = field(default_factory=set)
    own: Mapping[str, xr.Dataset] = field(default_factory=dict[str, xr.Dataset])

    @classmethod
    def of_study(
        cls,
        store: Store,
        study: StudyConfiguration,
        report: Callable[[str], None],
        volunteers: Iterable[str],
    ) -> Self:
        """Setup with the face of a study, or with those of the volunteers."""
        own = volunteer_faces(study.face, volunteers)
        face = next(iter(own.values())) if own else study_face(study.face)
        return cls(store, face, study, report, own=own)

    def for_volunteer(self, volunteer: str) -> Self:
        """Setup with the face of a volunteer."""
        if volunteer not in self.own:
            return self
        if volunteer not in self._by_volunteer:
            self._by_volunteer[volunteer] = replace(self, face=self.own[volunteer], own={})
        return self._by_volunteer[volunteer]

    @cached_property
    def _by_volunteer(self) -> dict[str, Self]:
        return {}

    @cached_property
    def face_digest(self) -> str:
        """Digest of the face."""
        return dataset_digest(self.face)

    @cached_property
    def moved(self) -> dict[str, str]:
        """Digests of what moves: the face, and the reduced face or the head if there is one."""
        files = {"reduced": self.study.simulation.reduced.file, "head": self.study.face.head}
        others = {name: file_digest(file) for name, file in files.items() if file is not None}
        return {"face": self.face_digest, **others}

    @cached_property
    def head(self) -> Head | None:
        """Head of the study, if it has one."""
        path = self.study.face.head
        return None if path is None else study_head(path)

    def head_of(self, activation: xr.DataArray) -> Head | None:
        """Head that moves under an activation: that of the study, if its muscles are those of a head."""
        own = set(self.face["muscle"].values.tolist())
        return self.head if not own.issuperset(activation["muscle"].values.tolist()) else None

    @property
    def alignment(self) -> dict[str, Any]:
        """Options of `analysis.align.align`, equal for all motions compared with a recording."""
        return {**self.study.alignment.arguments(), **self.limits}

    @property
    def limits(self) -> dict[str, Any]:
        """Least motion and signal-to-noise ratio of a marker with a score."""
        return self.study.score.model_dump(include={"smallest_motion", "smallest_snr"})

    def lowered(self, sigma_max: float) -> Self:
        """Return the same setup with another initial sigma_max [Pa], not calibrated."""
        given = self.study.simulation
        policy = given.sigma_max_policy.model_copy(update={"calibration": "none"})
        changes = {"sigma_max": sigma_max, "sigma_max_policy": policy}
        simulation = given.model_copy(update=changes)
        study = self.study.model_copy(update={"simulation": simulation})
        return replace(self, study=study)

    def extent(
        self, digests: Iterable[str], read: Callable[[], Iterable[xr.Dataset]], label: str
    ) -> Result:
        """Return minimum and maximum of the features over recordings with these digests."""
        inputs = {f"recording_{k}": digest for k, digest in enumerate(digests)}
        chain = self.study.signals
        parameters = chain.model_dump(
            mode="json", include={"filter", "feature", "mapping", "montage"}
        )
        return self.store.get_or_compute(
            RANGE, inputs, parameters, lambda: feature_range(read(), chain), label=label
        )

    def rest(self, parameters: SimulationParameters) -> Result:
        """Return the face at its equilibrium under gravity."""
        return self.store.get_or_compute(
            REST,
            {"face": self.face_digest},
            of_rest(parameters),
            lambda: settle_face(self.face, parameters),
            label=f"rest, sigma_max {parameters.sigma_max / 1e3:.4g} kPa",
        )
