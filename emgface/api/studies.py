"""Functions that run a whole study, and write its page."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from emgface.api.given import File, Given
    from emgface.study.run import StudyResult


def study(
    study: "Given" = None,
    out: "File | None" = None,
    *,
    workers: int = 1,
    scheduler: str | None = None,
    accuracy: str | None = None,
    progress: bool | None = None,
    **tables: Any,
) -> "StudyResult":
    """Run a study, or complete one that was interrupted.

    Parameters
    ----------
    study : path-like, mapping or StudyConfiguration, optional
        Study file (TOML), or its content.
    out : path-like
        Folder of the results. Results that are stored there are not computed again.
    workers : int
        Number of processes that simulate.
    scheduler : str, optional
        Address of a dask.distributed scheduler whose workers compute instead.
    accuracy : str, optional
        "draft", "study", "reference", "published", or the desired error such as "0.1 mm".
    progress : bool, optional
        Print a line of progress; by default for studies longer than a few seconds.
    **tables : Any
        Tables and parameters of the study file that replace those of `study`, such as
        ``recordings={"folder": "recordings"}`` or ``strategies=["act_all", "act_rel"]``.

    Returns
    -------
    StudyResult
        ``cube``: rho [1], amplitude ratio [1], distance [m] and status over volunteer, instruction,
        repetition, strategy and marker; ``path`` of its file; ``events``: computed and reused results.

    Raises
    ------
    ConfigurationError
        A name or value of a parameter is not valid, or no folder is specified.
    DataError
        No recording can be used, or the face is not valid.
    StoreError
        Results cannot be read or written.
    ExecutionError
        The scheduler or its workers cannot compute.

    Examples
    --------
    >>> import emgface as ef
    >>> result = ef.study("study.toml", "results", workers=4)  # doctest: +SKIP
    >>> result.cube.rho.median(["volunteer", "instruction", "repetition", "marker"])  # doctest: +SKIP
    """
    from emgface.api.given import changed, simulation_of, study_of
    from emgface.api.progress import shown
    from emgface.errors import ConfigurationError
    from emgface.files import expressible
    from emgface.run.cluster import DaskWorkers
    from emgface.study.file import check_axes
    from emgface.study.run import run_study

    if out is None:
        raise ConfigurationError(
            "no folder for the results of the study was specified, expected one: pass it as in "
            'ef.study(..., out="results")'
        )
    folder = expressible(out)
    plan = study_of(study)
    simulation = simulation_of(plan.simulation, accuracy, tables.pop("simulation", {}))
    plan = changed(plan, tables, "study").model_copy(update={"simulation": simulation})
    check_axes(plan, where="study")
    with shown(progress, f"study {plan.name}") as line:
        if scheduler is None:
            return run_study(plan, folder, workers=workers, observer=line)
        chosen = DaskWorkers(scheduler)
        try:
            return run_study(plan, folder, workers=chosen, observer=line)
        finally:
            chosen.end()


def report(
    folder: "File", out: "File | None" = None, *, faces: bool = True, tables: bool = True
) -> Path:
    """Write the tables of a finished study and its report, one page that opens without a network.

    Parameters
    ----------
    folder : path-like
        Folder of the results of `study`.
    out : path-like, optional
        Page to write (HTML); default: ``report.html`` in the folder.
    faces : bool
        Moving and drawn faces are part of the page; they require one simulation per instruction and
        strategy, which is stored.
    tables : bool
        Tables are written to ``folder/tables`` as CSV, Markdown and LaTeX.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    DataError
        The folder has no cube, or it cannot be read.
    StoreError
        The page or a table cannot be written.

    Examples
    --------
    >>> import emgface as ef
    >>> ef.report("results", "report.html")  # doctest: +SKIP
    """
    from emgface.api.given import target_or_none
    from emgface.files import expressible
    from emgface.report.results import study_cube
    from emgface.report.study_tables import write_tables
    from emgface.report.write import write_page

    place, target = expressible(folder), target_or_none(out)
    known = write_tables(study_cube(place), place) if tables else None
    page = target or place / "report.html"
    return write_page(place, page, faces=faces, known=known).path
