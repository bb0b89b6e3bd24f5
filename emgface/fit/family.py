"""Family of the generated faces: faces with one mesh by the parameters of their construction."""

from dataclasses import asdict, dataclass
from typing import Final

import numpy as np
import xarray as xr

from emgface.errors import FaceError
from emgface.face.template import template_face
from emgface.face.template.build import constructed_positions
from emgface.face.template.calibrate import (
    ConstructionParameters,
    calibrated_surfaces,
    surface_measures,
)
from emgface.face.template.grid import RAYS_PER_STEP, Grid, make_grid, refined_grid
from emgface.face.template.measures import Measures, bounds
from emgface.face.template.norms import NORMS
from emgface.face.template.surface import Surfaces
from emgface.face.template.volunteers import ASYMMETRY
from emgface.fit.carry import carry
from emgface.fit.similarity import Floats

MEASURE_SHARES: Final = (1.0, 0.75, 0.5, 0.25)
"""Shares of the way to the fitted measures, of which the first that yields a face is taken."""
SAME_FACE: Final = 1e-9  #: largest distance of the nodes of one face [m]

MEASURE_SPREADS: Final = {n.name: 0.5e-3 * (n.men[1] + n.women[1]) for n in NORMS} | dict(ASYMMETRY)
"""Standard deviations of the measures among adults [m]; of the asymmetry [1]."""


@dataclass(frozen=True)
class Family:
    """Generated faces with one mesh, by the parameters of their construction."""

    face: xr.Dataset  #: the member from which a fit starts
    grid: Grid
    measures: Measures
    start: Floats  #: (n,) parameters of this member [m]

    @classmethod
    def from_face(cls, face: xr.Dataset) -> "Family | None":
        """Family of a face; None unless its nodes are those of the generated face of its measures."""
        attrs = face.attrs
        names = [f"measure_{name}" for name in MEASURE_SPREADS]
        if attrs.get("origin") != "generated" or not all(name in attrs for name in names):
            return None
        measures = Measures(**{name[8:]: float(attrs[name]) for name in names})
        rays = int(attrs.get("rays", 0))
        for grid in (make_grid(face.sizes["element"]), refined_grid(max(1, rays // RAYS_PER_STEP))):
            if not np.array_equal(grid.connectivity, face["connectivity"].values):
                continue
            surfaces = calibrated_surfaces(measures)
            nodes = constructed_positions(surfaces, grid)
            if np.abs(nodes - face["position"].values).max() < SAME_FACE:
                start = np.array([getattr(surfaces.measures, name) for name in MEASURE_SPREADS])
                return cls(face, grid, measures, start)
        return None

    def surfaces(self, values: Floats) -> Surfaces:
        """Surfaces of parameters (n,) [m]."""
        return Surfaces(
            ConstructionParameters(**dict(zip(MEASURE_SPREADS, map(float, values), strict=True)))
        )

    def nodes(self, values: Floats) -> Floats:
        """Nodes (n_nodes, 3) of the member with these parameters [m]."""
        return constructed_positions(self.surfaces(values), self.grid)

    def measures_of(self, values: Floats) -> Measures:
        """Measures of the surfaces of parameters, within their bounds."""
        surfaces = self.surfaces(values)
        values_by_measure = asdict(surfaces.measures) | surface_measures(surfaces)
        return Measures(**{k: float(np.clip(v, *bounds(k))) for k, v in values_by_measure.items()})

    def member(self, values: Floats) -> xr.Dataset:
        """Face with the measures of these parameters, or the nearest on the way to them that exists.

        Muscles and attachments are those of the generated face; if the face of the beginning has others,
        they are carried along.
        """
        for share in MEASURE_SHARES:
            try:
                measures = self.measures_of(self.start + share * (values - self.start))
                return self._with(measures)
            except (FaceError, ValueError):
                continue
        return self.face

    def _with(self, measures: Measures) -> xr.Dataset:
        face, attrs = self.face, self.face.attrs
        if "muscle_radius" in attrs:
            given = {"resolution": self.grid, "radius": float(attrs["muscle_radius"])}
            same = template_face(measures=self.measures, **given)
            if all(name in face and same[name].equals(face[name]) for name in same.data_vars):
                generated = template_face(measures=measures, name=str(attrs["name"]), **given)
                return generated.assign_attrs(source=attrs["source"])
        nodes = constructed_positions(calibrated_surfaces(measures), self.grid)
        attributes = {f"measure_{name}": value for name, value in asdict(measures).items()}
        return carry(face, nodes).face.assign_attrs(attributes)
