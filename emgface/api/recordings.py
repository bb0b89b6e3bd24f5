"""Functions on recordings: reading, activation, scores of a simulated motion."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    import xarray as xr

    from emgface.api.given import Data, File, Given


def read(path: "File", *, mapping: "Mapping[str, Any] | File | None" = None) -> "xr.Dataset":
    """Read a recording of any supported format, or a file written by this package.

    Parameters
    ----------
    path : path-like
        Recording (``emgface check --help`` lists the formats), or a netCDF file of a face, an
        activation, a trajectory, scores or a cube.
    mapping : mapping or path-like, optional
        Tables ``channels``, ``markers`` and ``units`` that assign names to a recording's labels, or
        a TOML file with them (``emgface map`` proposes one).

    Returns
    -------
    Dataset
        Checked and in SI: sEMG in V, positions in m, times in s.

    Raises
    ------
    DataError
        The file is absent, damaged, or of an unknown format or content.
    ConfigurationError
        The mapping is not valid.

    Examples
    --------
    >>> import emgface as ef
    >>> recording = ef.read("V1_A_1.c3d", mapping="mapping.toml")  # doctest: +SKIP
    """
    from emgface.anatomy.checked import read_model
    from emgface.api.given import kind_of_given, recording_of
    from emgface.face.file import load_face
    from emgface.files import expressible

    path = expressible(path)
    kind = kind_of_given(path, "a file")
    if kind == "face_model":
        return load_face(path)
    if kind not in ("", "recording"):
        return read_model(path, kind)
    return recording_of(path, mapping)


def describe(
    path: "File",
    *,
    out: "File | None" = None,
    rate: float | None = None,
    unit: str | None = None,
    columns: "Sequence[str] | None" = None,
    variable: str | None = None,
    confirmed: bool = False,
) -> str:
    """Draft the sidecar of a text table, a MATLAB or an HDF5 file from its contents.

    Parameters
    ----------
    path : path-like
        Table or array.
    out : path-like, optional
        Sidecar to write (TOML), in the folder of the file or above it.
    rate : float, optional
        Sampling rate [Hz], if it is known.
    unit : str, optional
        Unit of the EMG, if it is known: V, mV, uV or nV.
    columns : sequence of str, optional
        Labels of the columns, if the file contains none.
    variable : str, optional
        Array of a MATLAB or HDF5 file that contains the recording.
    confirmed : bool
        Accept all guesses, which are otherwise listed under ``unconfirmed``.

    Returns
    -------
    str
        Sidecar (TOML).

    Raises
    ------
    DataError
        The file is absent, of a format that requires no sidecar, or contains no rows of numbers.
    UnitsError
        `unit` is no voltage.

    Examples
    --------
    >>> import emgface as ef
    >>> print(ef.describe("recording.csv", out="recording.toml"))  # doctest: +SKIP
    """
    from emgface.api.given import target_or_none
    from emgface.files import expressible, refuse_existing, write_text
    from emgface.recordings.describe import describe as draft

    target = target_or_none(out)
    refuse_existing(target)
    folder = None if target is None else target.parent
    text = draft(
        expressible(path), sidecar_folder=folder, rate=rate, unit=unit, columns=columns,
        variable=variable, confirmed=confirmed,
    )  # fmt: skip
    if target is not None:
        write_text(target, text)
    return text


def activate(
    recording: "Data",
    *,
    strategy: str | None = None,
    instruction: str | None = None,
    mapping: "Mapping[str, Any] | File | None" = None,
    study: "Given" = None,
    band: tuple[float, float] | None = None,
    feature: str | Mapping[str, Any] | None = None,
    missing_side: str | None = None,
    missing_muscle: str | None = None,
    session: "xr.Dataset | None" = None,
    reference: "Data | Sequence[Data] | None" = None,
    **tables: Mapping[str, Any],
) -> "xr.Dataset":
    """Compute muscle activations from the sEMG of a recording.

    Parameters
    ----------
    recording : Dataset or path-like
        Recording of one trial: ``emg`` (channel, time_emg) [V].
    strategy : str, optional
        "act_all", "act_3", "act_rel" or "act_threshold"; "true" for the true activation of a
        simulated recording. Default: that of the study.
    instruction : str, optional
        A to F, if the recording does not specify it; required by "act_rel".
    mapping : mapping or path-like, optional
        As for `read`, if `recording` is a file.
    study : path-like, mapping or StudyConfiguration, optional
        Study whose table ``[signals]`` applies.
    band : tuple of float, optional
        Edges of the pass-band [Hz].
    feature : str or mapping, optional
        Amplitude feature: "wamp", "rms", "mav" or "envelope"; or the table ``[signals.feature]``.
    missing_side, missing_muscle : str, optional
        Treatment of a channel that was recorded on the other side only ("mirror", "zero" or
        "leave_out"), and of one that was recorded on neither side ("zero" or "leave_out").
    session, reference : Dataset, optional
        Range of the features (`emgface.signals.activation.feature_range`), to which the normalisation
        then refers. `reference` may also be a maximum-effort recording of the same volunteer or its
        file, or a sequence of them.
    **tables : mapping
        Further tables of ``[signals]`` in a study file, such as ``normalisation={"silent": "zero"}``.

    Returns
    -------
    Dataset
        ``activation`` (muscle, time) [1], between 0 and 1, at times in s.

    Warns
    -----
    FeatureWarning
        The check of the recording (`emgface check`) found something about its channels; the
        attribute ``findings`` of the result contains it as data.

    Raises
    ------
    DataError
        The recording cannot be processed, as `emgface.signals.activation.activation_of`.
    ConfigurationError
        A name or value of a parameter is not valid; a strategy or an instruction is unknown.

    Examples
    --------
    >>> import emgface as ef
    >>> activation = ef.activate("V1_A_1.nc", strategy="act_rel", band=(20, 400))  # doctest: +SKIP
    """
    import numpy as np
    import xarray as xr

    from emgface.api.given import changed, merged, recording_of, signals_of
    from emgface.errors import ConfigurationError, listed
    from emgface.recordings.findings import findings_in
    from emgface.recordings.repeated import for_activation, stored_with, warn_of
    from emgface.signals.activation import activation_of, feature_range
    from emgface.signals.truth import TRUE_STRATEGY, true_activation_of

    given = recording_of(recording, mapping)
    if band is not None and (isinstance(band, str) or np.shape(band) != (2,)):
        raise ConfigurationError(
            f"the pass-band is {band!r}, expected its two edges in Hz: pass for example (20, 400)"
        )
    if strategy == TRUE_STRATEGY:
        given_too = {
            "instruction": instruction, "band": band, "feature": feature,
            "missing_side": missing_side, "missing_muscle": missing_muscle, "session": session,
            "reference": reference, **{name: v for name, v in tables.items() if name != "resampling"},
        }  # fmt: skip
        if idle := [n for n, v in given_too.items() if v is not None and not _empty(v)]:
            raise ConfigurationError(
                f"strategy 'true' is the activation that a simulation stored, on which {listed(idle)} "
                "has no effect, expected another strategy with it: leave it out"
            )
    low, high = band if band is not None else (None, None)
    options: dict[str, Any] = {
        "filter": {"low": low, "high": high},
        "feature": feature if isinstance(feature, Mapping) else {"kind": feature},
        "montage": {"missing_side": missing_side, "missing_muscle": missing_muscle},
    }
    for table, named in options.items():
        chosen = {name: value for name, value in named.items() if value is not None}
        tables = merged(tables, {table: chosen} if chosen else {})
    one_file = isinstance(reference, str) or not isinstance(reference, Iterable | None)
    if one_file or (isinstance(reference, xr.Dataset) and "emg" in reference):
        reference = cast("Sequence[Data]", [reference])  # one recording of maximum effort
    extent = reference if isinstance(reference, xr.Dataset) else None
    tables = merged(tables, _reach(session, reference, tables.get("normalisation")))
    chain = changed(signals_of(study), tables, "signals")
    if reference is not None and not isinstance(reference, xr.Dataset):
        efforts = cast("Sequence[Data]", reference)
        extent = feature_range((recording_of(one, mapping) for one in efforts), chain)
    if strategy == TRUE_STRATEGY:
        return true_activation_of(given, chain.resampling)
    findings = for_activation(given)
    warn_of(findings)
    activation = activation_of(
        given,
        chain,
        strategy=strategy,
        instruction=instruction,
        session=session,
        reference=extent,
    )
    # A count that is zero throughout was warned of when it was computed.
    warn_of(one for one in findings_in(activation) if one.values.get("high") != 0.0)
    return stored_with(activation, findings)


def _empty(value: object) -> bool:
    return isinstance(value, Mapping) and not value


def _reach(session: object, reference: object, table: Any) -> dict[str, Any]:
    """Reach of the normalisation for a range that is passed; ConfigurationError for another one.

    A range of which the normalisation makes no use would be a result other than asked for.
    """
    from emgface.errors import ConfigurationError

    given = [n for n, v in (("session", session), ("reference", reference)) if v is not None]
    if not given:
        return {}
    named = table.get("reach") if isinstance(table, Mapping) else getattr(table, "reach", None)
    if len(given) > 1 or (named is not None and named != given[0]):
        raise ConfigurationError(
            f"found a range of the {' and of the '.join(given)}"
            + (f" with normalisation over the {named}" if named is not None else "")
            + ", expected the one range to which the normalisation refers: pass that one only"
        )
    return {"normalisation": {"reach": given[0]}}


def score(
    recording: "Data",
    trajectory: "Data",
    *,
    face: "Data | None" = None,
    study: "Given" = None,
    mapping: "Mapping[str, Any] | File | None" = None,
    alignment: "Mapping[str, Any] | None" = None,
    score: "Mapping[str, Any] | None" = None,
) -> "xr.Dataset":
    """Align measured with simulated lip motion and score every marker.

    Parameters
    ----------
    recording : Dataset or path-like
        Recording of the trial: ``position`` (marker, axis, time_marker) [m].
    trajectory : Dataset or path-like
        Result of `simulate`.
    face : Dataset or path-like, optional
        Face model that was simulated; default: that of the study.
    study : path-like, mapping or StudyConfiguration, optional
        Study whose tables apply.
    mapping : mapping or path-like, optional
        As for `read`, if `recording` is a file.
    alignment, score : mapping, optional
        Parameters of the tables ``[alignment]`` and ``[score]`` of a study file.

    Returns
    -------
    Dataset
        ``rho`` (marker) [1], the 3D correlation; ``amplitude_ratio`` [1], ``rmse`` [m], ``reason``
        of an undefined rho, and the results of the alignment (``shift`` [s], ...).

    Warns
    -----
    FeatureWarning
        The check of the recording found something about its face and lip markers, or about the
        channels from which the motion was computed; the attribute ``findings`` contains it as data.

    Raises
    ------
    DataError
        Markers are absent or not visible during the simulated time.
    AnalysisError
        The motions cannot be aligned or compared.
    ConfigurationError
        A name or value of a parameter is not valid.

    Examples
    --------
    >>> import emgface as ef
    >>> ef.score("V1_A_1.nc", trajectory, face=face).rho.median()  # doctest: +SKIP
    """
    _, scores = aligned_and_scored(
        recording,
        trajectory,
        face=face,
        study=study,
        mapping=mapping,
        alignment=alignment,
        score=score,
    )
    return scores


def aligned_and_scored(
    recording: "Data",
    trajectory: "Data",
    *,
    face: "Data | None" = None,
    study: "Given" = None,
    mapping: "Mapping[str, Any] | File | None" = None,
    alignment: "Mapping[str, Any] | None" = None,
    score: "Mapping[str, Any] | None" = None,
) -> "tuple[xr.Dataset, xr.Dataset]":
    """Aligned measured motion and scores of a trial, with the arguments of `score`."""
    from analysis.align import align
    from analysis.scores import score as score_trial
    from emgface.api.given import changed, dataset_of, face_of, recording_of, study_of
    from emgface.face.measured import measured_during
    from emgface.recordings.belonging import of_face, of_recording, of_times
    from emgface.recordings.findings import findings_in
    from emgface.recordings.repeated import for_scores, stored_with, warn_of

    plan = study_of(study)
    alignment_choices = changed(plan.alignment, alignment or {}, "alignment")
    score_choices = changed(plan.score, score or {}, "score")
    motion = dataset_of(trajectory, "trajectory", "position")
    given = recording_of(recording, mapping)
    model = face_of(face, plan)
    findings = [
        *for_scores(given),
        *of_face(motion.attrs, model, "motion"),
        *of_recording(motion.attrs, given.attrs),
        *of_times(motion, given, "time_marker", "recording of the markers"),
    ]
    warn_of([*findings_in(motion), *findings])
    measured = measured_during(given, motion, model, plan.signals.head_frame)
    aligned = align(
        measured,
        motion,
        smallest_motion=score_choices.smallest_motion,
        smallest_snr=score_choices.smallest_snr,
        **alignment_choices.arguments(),
    )
    scores = score_trial(aligned, motion, **score_choices.model_dump())
    return aligned, stored_with(scores, findings, motion)
