"""Virtual treatment of a face, and the comparison of its movement before and after."""

import os
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

if TYPE_CHECKING:
    from emgface.api.given import Data, File
    from emgface.api.progress import Show
    from emgface.treatment.comparison import FaceComparison
    from emgface.treatment.plan import Plan


def treat(
    face: "Data",
    plan: "Plan | Mapping[str, Any] | str | os.PathLike[str]",
    **choices: Any,
) -> "xr.Dataset":
    """Treat a face or a jaw by a plan: excise and close, weaken, stiffen, resect.

    A research model, not validated on patients; not for treatment decisions.

    Parameters
    ----------
    face : Dataset or path-like
        Face model, or jaw model.
    plan : Plan, mapping or path-like
        Steps of the treatment (`emgface.treatment.plan.Plan`), or the path of its TOML file.
    **choices : Any
        Parameters of the table ``[simulation]`` of a study file for the tissue that is closed, such
        as ``sigma_max=300e3`` [Pa].

    Returns
    -------
    Dataset
        Face model in which the wound is closed and the tissue in equilibrium, or jaw model, with the
        plan, a report of every step and the digest of the untreated model as attributes. A plan
        without effect returns the model itself. Doubts on lengths that may be in another unit are
        warnings (TreatmentWarning).

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
    from emgface.anatomy.checked import read_model
    from emgface.anatomy.jaw.model import check_jaw
    from emgface.api.given import face_of, kind_of_given, path_of, simulation_of, study_of
    from emgface.choices import configure
    from emgface.errors import ConfigurationError, TreatmentWarning
    from emgface.face.identity import treatments
    from emgface.files import expressible
    from emgface.treatment.plan import Plan, read_plan
    from emgface.treatment.treat import treat_face, treat_jaw

    folder = Path()
    if isinstance(plan, Plan):
        own = plan
    elif isinstance(plan, str | os.PathLike):
        own, folder = read_plan(expressible(plan)), Path(plan).parent
    else:
        own = configure(Plan, plan, where="plan")
    if kind_of_given(face, "a face or a jaw") == "jaw_model":
        if not isinstance(face, xr.Dataset):
            face = read_model(path_of(face, "a jaw"), "jaw_model")
        if choices:
            raise ConfigurationError(
                f"{next(iter(choices))} was specified for a jaw, expected no parameter of a simulation: "
                "the treatment of a jaw simulates nothing"
            )
        return treat_jaw(check_jaw(face), own)
    study = study_of(None)
    parameters = simulation_of(study.simulation, None, choices)
    given = face_of(face, study)
    treated = treat_face(given, own, parameters, folder=folder)
    for entry in [] if treated is given else treatments(treated)[-1:]:
        for report in entry["steps"]:
            for doubt in report.get("doubts", ()):
                warnings.warn(f"step {report['step']}: {doubt}", TreatmentWarning, stacklevel=2)
    return treated


def compare(
    before: "Data",
    after: "Data",
    recordings: "File | None" = None,
    *,
    mapping: "File | None" = None,
    page: "File | None" = None,
    plain: "File | None" = None,
    reduced: "Sequence[File]" = (),
    both_cuts: bool = False,
    spread: "File | None" = None,
    store: "File | None" = None,
    accuracy: str = "draft",
    workers: int = 1,
    progress: "Show | bool | None" = None,
    **choices: Any,
) -> "FaceComparison":
    """Simulate two faces under the same activations, and compare their movement.

    A research model, not validated on patients; not for treatment decisions.

    Parameters
    ----------
    before, after : Dataset or path-like
        Face models before and after a treatment (`treat`).
    recordings : path-like, optional
        Folder with recordings of the instructions of one person; by default, the activations are the
        gestures of the instructions. `mapping` is their mapping file.
    page, plain : path-like, optional
        Pages to write (HTML): with both faces under one time cursor, and without terms of the field.
    reduced : sequence of path-like
        Reduced faces of both (`reduce`), simulated with the contact of their training.
    both_cuts : bool
        Also cut by the other method, and give the interval of both.
    spread : path-like, optional
        Table of ``emgface dose --plan``, whose intervals the outcomes get.
    store : path-like, optional
        Folder that keeps complete motions, so that a repeated call computes only the others; by
        default that of the page, if one is written.
    accuracy : str
        "draft", "study", "reference", "published", or the desired error such as "0.1 mm".
    workers : int
        Number of processes that simulate.
    progress : bool or callable, optional
        Print a line of progress; by default for more than a few seconds.
    **choices : Any
        Parameters of the table ``[simulation]`` of a study file, such as ``sigma_max=100e3`` [Pa] or
        ``contact={"method": "none"}``.

    Returns
    -------
    FaceComparison
        ``outcomes`` and ``movement`` (DataFrame): clinical measures before and after with their units,
        rho [1] and amplitude ratio [1] by movement; ``motions`` of both faces (`ComparedMotions`);
        ``page(plain=False)`` returns the page as text.

    Raises
    ------
    DataError
        A face is not valid, `after` is no treatment of `before`, or no recording can be used.
    FaceError
        A reduced face belongs to neither of them, or was trained with other parameters.
    ConfigurationError
        A name or value of a parameter is not valid.

    Examples
    --------
    >>> import emgface as ef
    >>> compared = ef.compare("face.nc", "operated.nc", page="page.html")  # doctest: +SKIP
    >>> compared.outcomes  # doctest: +SKIP
    """
    from emgface.api.given import (
        face_of,
        path_of,
        path_or_none,
        simulation_of,
        study_of,
        target_or_none,
    )
    from emgface.api.progress import shown
    from emgface.errors import ConfigurationError
    from emgface.files import expressible, write_text
    from emgface.reduced.model import contact_of
    from emgface.treatment.comparison import compare_faces
    from emgface.treatment.reduced_pair import refuse_reduced

    if mapping is not None and recordings is None:
        raise ConfigurationError(
            "the mapping has no effect without recordings, expected a folder of recordings: pass both, "
            "or leave it out"
        )
    study = study_of(None)
    pages = ((target_or_none(page), False), (target_or_none(plain), True))
    faces = (before, after)
    refuse_reduced(*(path_of(x, "a face") for x in faces if not isinstance(x, xr.Dataset)))
    given = {"contact": contact_of(expressible(reduced[0]))} if reduced else {}
    parameters = simulation_of(study.simulation, accuracy, given | choices)
    if store is None and page is not None:
        store = expressible(page).with_suffix("").absolute() / "store"
    with shown(progress, "comparison") as line:
        compared = compare_faces(
            face_of(before, study), face_of(after, study), parameters,
            recordings=path_or_none(recordings), mapping=path_or_none(mapping),
            reduced=[expressible(file) for file in reduced], both_cuts=both_cuts,
            spread=path_or_none(spread), store=path_or_none(store), workers=workers,
            progress=line.show,
        )  # fmt: skip
    for path, simple in pages:
        if path is not None:
            write_text(path, compared.page(plain=simple))
    return compared
