"""Functions on faces: generation and simulation."""

import warnings
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    import xarray as xr

    from emgface.api.given import Data, File, Given
    from emgface.api.progress import Show
    from sim.probes import Probe


def face(
    path: "File | None" = None,
    *,
    resolution: str | int = "medium",
    preset: str = "adult",
    measures: Mapping[str, str | float] | None = None,
    seed: int | None = None,
) -> "xr.Dataset":
    """Generate a lower face from published measures, or read a face model.

    Parameters
    ----------
    path : path-like, optional
        Face model written by ``emgface build face`` or ``emgface import face``; by default a face
        is generated.
    resolution : str or int
        "coarse" (576 elements), "medium" (2448), "fine" (6480), or an approximate number of elements.
    preset : str
        Group of people: "adult", "woman", "man", "older_woman", "older_man", "girl" or "boy".
    measures : mapping, optional
        Measures that replace those of the group: numbers in m, or texts with their unit as
        ``{"mouth_width": "52mm"}``.
    seed : int, optional
        Draw a random person of the group instead of its means.

    Returns
    -------
    Dataset
        Checked face model: nodes [m], elements, muscles, markers.

    Raises
    ------
    FaceError
        A file does not contain a valid face; a measure, a group or a resolution is impossible.

    Examples
    --------
    >>> import emgface as ef
    >>> face = ef.face(preset="woman", resolution="coarse")
    >>> face.sizes["element"]
    576
    """
    if path is not None:
        from emgface.face.file import load_face

        return load_face(path)
    from emgface.face.template import parse_measures, template_face

    given = measures or {}
    parsed = parse_measures([f"{name}={v}" for name, v in given.items() if isinstance(v, str)])
    numbers = {name: float(v) for name, v in given.items() if not isinstance(v, str)}
    return template_face(
        resolution=resolution, preset=preset, seed=seed, measures=(parsed | numbers) or None
    )


def reduce(
    face: "Data | None" = None,
    *,
    study: "Given" = None,
    folder: "File | None" = None,
    progress: "Callable[[str, int, int], None] | None" = None,
    modes: int | None = None,
    elements: int | None = None,
    seed: int | None = None,
    training: "Mapping[str, Any] | None" = None,
    **choices: Any,
) -> "xr.Dataset":
    """Train a reduced face, which simulates many times faster than full order.

    Parameters
    ----------
    face : Dataset or path-like, optional
        Face model; default: that of the study, which by default is a generated face.
    study : path-like, mapping or StudyConfiguration, optional
        Study whose tables ``[simulation]`` and ``[face]`` apply.
    folder : path-like, optional
        Folder for the motions of the training, with which an interrupted training resumes; default:
        they are not kept.
    progress : callable, optional
        Called with the description of the current motion, the completed number and the total.
    modes, elements, seed : int, optional
        Number of modes that move (a multiple of three), largest number of weighted elements, seed of
        the random activations.
    training : mapping, optional
        Further parameters of `emgface.reduced.parameters.ReductionParameters`.
    **choices : Any
        Parameters of the table ``[simulation]`` of a study file, such as ``sigma_max=100e3`` [Pa].

    Returns
    -------
    Dataset
        Reduced face, for ``ef.simulate(..., reduced={"file": "face.rom.nc"})`` once written.

    Raises
    ------
    ConfigurationError
        A name or value of a parameter is not valid.
    SceneError
        The parameters have parts that a reduced face does not support.

    Examples
    --------
    >>> import emgface as ef
    >>> reduced = ef.reduce("face.nc", sigma_max=100e3)  # doctest: +SKIP
    """
    from tempfile import TemporaryDirectory

    from emgface.api.given import face_of, simulation_of, study_of
    from emgface.choices import configure
    from emgface.files import expressible
    from emgface.reduced.parameters import ReductionParameters
    from emgface.reduced.training import reduce_face
    from emgface.run.store import Store

    plan = study_of(study)
    parameters = simulation_of(plan.simulation, None, choices)
    given = {"modes": modes, "elements": elements, "seed": seed}
    options = {name: v for name, v in given.items() if v is not None} | dict(training or {})
    size = configure(ReductionParameters, options, where="reduction")
    with TemporaryDirectory() as unkept:
        store = Store(expressible(unkept if folder is None else folder))
        return reduce_face(face_of(face, plan), parameters, size, store, progress=progress)


def simulate(
    activation: "xr.DataArray | Data | Mapping[str, float]",
    face: "Data | None" = None,
    *,
    duration: float | None = None,
    study: "Given" = None,
    accuracy: str | None = None,
    settled: "xr.Dataset | None" = None,
    surface: bool = False,
    probes: "tuple[Probe, ...]" = (),
    progress: "Show | bool | None" = None,
    solver_threads: int = 1,
    waypoints: "tuple[File, float] | None" = None,
    branch: "tuple[File, float] | None" = None,
    calibrate: "Sequence[File]" = (),
    **choices: Any,
) -> "xr.Dataset":
    """Simulate the motion of a face for an activation.

    If an element inverts or a step does not converge, sigma_max is lowered by the rule of the
    parameters ``sigma_max_policy``.

    Parameters
    ----------
    activation : Dataset, DataArray, path-like or mapping
        ``activation`` (muscle, time) [1] of every muscle of the face, at times in s; or levels [1] of
        some muscles, which are reached in 0.1 s.
    face : Dataset or path-like, optional
        Face model; default: that of the study, which by default is a generated face.
    duration : float, optional
        Simulated time [s] of levels of muscles; default: 0.5.
    study : path-like, mapping or StudyConfiguration, optional
        Study whose tables ``[simulation]`` and ``[face]`` apply.
    accuracy : str, optional
        "draft", "study", "reference", "published", "realtime" (with a reduced face), or the desired
        error such as "0.1 mm".
    settled : Dataset, optional
        Face at rest (`emgface.face.motion.settle_face`) for the parameters, if it has been computed.
    surface : bool
        Store the surface of the face in the trajectory, which `show` requires to move it, and the
        forces of the muscles and of contact [N].
    probes : tuple of sim.probes.Probe
        Probes in addition to markers and lip opening, such as ``sim.Positions()``.
    progress : bool or callable, optional
        Print a line of progress; by default for runs longer than a few
        seconds. A callable receives the completed and the total number of steps.
    solver_threads : int
        Threads of the linear solver. With more than one, a large face takes less time on idle cores,
        and the last digits differ between processes, as the attribute ``note`` then states.
    waypoints : (path-like, float), optional
        New folder for states of the motion, and the time between them [s].
    branch : (path-like, float), optional
        Folder of way points, and the time [s] of the one at which the motion begins. With the
        activation of the motion that wrote them, it repeats its rest bit for bit.
    calibrate : sequence of path-like
        Other recordings of the volunteer: sigma_max is the value at which face and volunteer move
        equally far in them (`emgface.study.calibrated`), with the strategy of the activation.
    **choices : Any
        Parameters of the table ``[simulation]`` of a study file, such as ``sigma_max=100e3`` [Pa] or
        ``contact={"method": "none"}``.

    Returns
    -------
    Dataset
        Trajectory: ``position`` (marker, axis, time) [m], ``lip_opening`` [m], ``smallest_J`` [1],
        energies [J], ``numerical_error`` [m]; see `emgface.face.motion.simulate_face`.

    Warns
    -----
    MotionWarning
        The estimated error exceeds a tenth of the motion, the motion depends on rounding, or its
        reduction is not trusted.

    Raises
    ------
    ActivationError
        The activation is not that of the muscles of the face, or leaves 0-1.
    ConfigurationError
        A name or value of a parameter is not valid.
    SimulationError
        No value of sigma_max down to its minimum could be simulated.

    Examples
    --------
    >>> import emgface as ef
    >>> trajectory = ef.simulate("activation.nc", "face.nc", accuracy="draft")  # doctest: +SKIP
    >>> trajectory = ef.simulate({"ZYG_L": 0.5, "ZYG_R": 0.5})  # doctest: +SKIP
    """
    import xarray as xr

    from emgface.api.given import dataset_of, face_of, simulation_of, study_of
    from emgface.api.progress import shown
    from emgface.errors import ConfigurationError, MotionWarning
    from emgface.face.doubts import doubts_of
    from emgface.face.identity import DIGEST
    from emgface.face.motion import settle_face, simulate_face
    from emgface.face.sigma_max import lower_sigma_max
    from emgface.face.waypoints import Branch, WayPoints
    from emgface.files import expressible
    from emgface.models.face import constant_activation
    from emgface.pictures.body import skin_of
    from emgface.pictures.surface import SurfaceProbe, with_surface
    from emgface.recordings.belonging import of_face
    from emgface.recordings.findings import ATTRIBUTE, findings_in, with_findings
    from emgface.recordings.repeated import warn_of
    from emgface.recordings.trial_names import TRIAL_FIELDS
    from emgface.study.calibrated import calibrated_for

    plan = study_of(study)
    parameters = simulation_of(plan.simulation, accuracy, choices)
    model = face_of(face, plan)
    if isinstance(activation, Mapping) and not isinstance(activation, xr.Dataset):
        activation = constant_activation(model, activation, duration)
    elif duration is not None:
        raise ConfigurationError(
            f"duration = {duration:g} s cannot be applied to an activation, whose times are its own, "
            "expected levels of muscles with it: leave it out"
        )
    if isinstance(activation, xr.DataArray):
        named = activation.to_dataset(name="activation", promote_attrs=False)
        drive = dataset_of(named, "activation", "activation")["activation"]
        attrs = activation.attrs
    else:
        given = dataset_of(activation, "activation", "activation")
        drive, attrs = given["activation"], given.attrs
        warn_of(findings_in(given))
    other = of_face(attrs, model, "activation") if DIGEST in attrs else []
    warn_of(other)
    if calibrate:
        trained = plan.model_copy(update={"simulation": parameters})
        training = [expressible(path) for path in calibrate]
        update = {"sigma_max": calibrated_for(attrs, training, model, trained)}
        parameters = parameters.model_copy(update=update)
    stress = float(attrs.get("sigma_max", parameters.sigma_max))
    if abs(stress / parameters.sigma_max - 1.0) > 1e-6:
        warnings.warn(
            f"the activation is relative to a largest stress of {stress:g} Pa, the simulation has "
            f"{parameters.sigma_max:g} Pa: set sigma_max to the value of the inversion",
            stacklevel=2,
        )
    skin = skin_of(model) if surface else None
    further = (*probes, SurfaceProbe(skin.node)) if skin else probes
    kept = None if waypoints is None else WayPoints(expressible(waypoints[0]), waypoints[1])
    begun = None if branch is None else Branch.from_folder(expressible(branch[0]), branch[1])
    with shown(progress, "simulating") as line:

        def once(chosen: Any) -> "xr.Dataset":
            same = settled is not None and chosen.sigma_max == parameters.sigma_max
            rest = settled if same or begun else settle_face(model, chosen)
            return simulate_face(
                model,
                drive,
                chosen,
                settled=rest,
                further=further,
                progress=line.show,
                solver_threads=solver_threads,
                waypoints=kept,
                branch=begun,
                forces=surface,
            )

        trajectory = lower_sigma_max(once, parameters, report=line.message)
    if skin:
        trajectory = with_surface(trajectory, model, skin)
    for doubt in doubts_of(trajectory):
        warnings.warn(doubt, MotionWarning, stacklevel=2)
    keep = (*TRIAL_FIELDS, "source_digest", "strategy", "montage", ATTRIBUTE)
    trajectory.attrs |= {name: attrs[name] for name in keep if name in attrs}
    return with_findings(trajectory, other) if other else trajectory
