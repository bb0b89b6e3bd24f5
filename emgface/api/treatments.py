"""Virtual treatment of a face."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray as xr

    from emgface.api.given import Data
    from emgface.treatment.plan import Plan


def treat(
    face: "Data",
    plan: "Plan | Mapping[str, Any] | str | os.PathLike[str]",
    **choices: Any,
) -> "xr.Dataset":
    """Treat a face by a plan: excise and close, weaken, stiffen.

    A research model, not validated on patients; not for treatment decisions.

    Parameters
    ----------
    face : Dataset or path-like
        Face model.
    plan : Plan, mapping or path-like
        Steps of the treatment (`emgface.treatment.plan.Plan`), or the path of its TOML file.
    **choices : Any
        Parameters of the table ``[simulation]`` of a study file for the tissue that is closed, such
        as ``sigma_max=300e3`` [Pa].

    Returns
    -------
    Dataset
        Face model in which the wound is closed and the tissue in equilibrium, with the plan, a report
        of every step and the digest of the untreated face as attributes. A plan without effect
        returns the face itself.

    Raises
    ------
    ConfigurationError
        A name or value of the plan is not valid.
    FaceError
        A step is not possible; the message contains the step and the reason.

    Examples
    --------
    >>> import emgface as ef
    >>> step = {"kind": "wedge", "lip": "lower", "width": 12.0, "height": 10.0}
    >>> operated = ef.treat("face.nc", {"step": [step]})  # doctest: +SKIP
    """
    from emgface.api.given import face_of, simulation_of, study_of
    from emgface.choices import configure
    from emgface.treatment.plan import Plan, read_plan
    from emgface.treatment.treat import treat_face

    folder = Path()
    if isinstance(plan, Plan):
        own = plan
    elif isinstance(plan, Mapping):
        own = configure(Plan, plan, where="plan")
    else:
        own, folder = read_plan(Path(plan)), Path(plan).parent
    study = study_of(None)
    parameters = simulation_of(study.simulation, None, choices)
    return treat_face(face_of(face, study), own, parameters, folder=folder)
