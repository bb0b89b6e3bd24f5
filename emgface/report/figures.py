"""Figures of a report as SVG elements."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from markupsafe import Markup
from matplotlib.figure import Figure

from analysis.baselines import has_baselines
from analysis.errors import AnalysisError
from analysis.figures import (
    activation_heat_map,
    baseline_plot,
    box_plots,
    difference_map,
    emg_with_features,
    feature_boxes,
    formant_plot,
    marker_traces,
    sensitivity_plot,
    synchronisation,
)
from analysis.figures.style import title_of
from analysis.tables import origin_of
from emgface.errors import FeatureWarning
from emgface.inverse.configuration import VARIANT
from emgface.muscles import INSTRUCTIONS
from emgface.pictures.body import Body
from emgface.pictures.page import svg_of
from emgface.report.faces import study_faces
from emgface.report.jaw import Incisors
from emgface.report.results import FAILURES, ReportedTrial, Results, representative
from emgface.signals.activation import feature_before_normalisation
from emgface.signals.features import MuteFeature, feature_of
from emgface.signals.filters import bandpass

CHANNELS_SHOWN = ("OOS_L", "OOI_L", "RIS_L", "ZYG_L", "LLSAN_L", "DAO_L", "MEN_L")


FIGURE_SCALE = 1.4  #: of the figures of a page, so that their print is as large as its text


@dataclass(frozen=True)
class Drawn:
    """Figure of the page: anchor (one word), title, caption and picture."""

    name: str
    title: str
    caption: str
    svg: Markup


def score_figures(results: Results) -> list[Drawn]:
    """Draw the distributions of the scores."""
    cube = results.base
    if not np.isfinite(cube["rho"].values).any():
        return []
    texts = {
        "rho": "3D correlation of simulated with measured markers, after Fig. 6 of Eskes et al. "
        "2017. Boxes span the quartiles; the line is the median, and the dot is the mean. Whiskers "
        "reach the last value within 1.5 interquartile ranges; crosses are values beyond. Fewer than 8 "
        "values are drawn as points, with their median as a line.",
        "amplitude_ratio": "Amplitude of the simulated movement divided by that of the measured "
        "movement; 1 means equal amplitudes. rho does not depend on this ratio.",
        "rmse": "Root-mean-square distance of simulated from measured markers.",
    }
    drawn: list[Drawn] = []
    for variable, text in texts.items():
        if not np.isfinite(cube[variable].values).any():
            continue
        title = {"rho": "Correlation", "rmse": "Distance"}.get(variable, "Amplitude ratio")
        drawn += _drawn(
            results,
            variable,
            title,
            text,
            lambda variable=variable: box_plots(cube, variable=variable, labels=INSTRUCTIONS),
        )
    return drawn


def baseline_figure(results: Results) -> list[Drawn]:
    """Draw rho with its baselines."""
    text = (
        "Mean rho per instruction and strategy (large symbols) and of each volunteer (small "
        "symbols), compared with baselines that do not use the EMG of the trial. Above: "
        "rho; below: 1 - rho on a logarithmic axis. A strategy below the band predicts a "
        "trial less well than the mean motion of other people."
    )
    cube = results.base
    if not has_baselines(cube):
        return []
    return _drawn(
        results, "baselines", "Baselines", text, lambda: baseline_plot(cube, labels=INSTRUCTIONS)
    )


def formant_figure(results: Results) -> list[Drawn]:
    """Draw the formants over time."""
    text = (
        "Formants F1 and F2 over the duration of a trial: median over volunteers and repetitions, "
        "with a band between the quartiles. The formants change with the simulated lips; the vocal "
        "tract behind the lips does not move."
    )
    cube = results.base
    if "formant_frequency" not in cube:
        return []
    return _drawn(
        results, "formants", "Formants", text, lambda: formant_plot(cube, labels=INSTRUCTIONS)
    )


def incisor_figure(results: Results, incisors: Incisors) -> list[Drawn]:
    """Draw the path of the lower incisor in one trial."""
    text = (
        f"Trial {incisors.label}: displacement of the lower incisor relative to the skull along x, y "
        "and z, measured (aligned) and simulated."
    )
    return _drawn(results, "incisor", "Lower incisor", text, lambda: incisors.figure)


def scored_face_figure(results: Results, faces: xr.Dataset, body: Body) -> list[Drawn]:
    """Draw the faces at their largest displacements."""
    text = (
        "Simulated faces at the instant of the largest marker displacement, after Fig. 4 of Eskes et "
        "al. 2017. The markers of the recording at that instant are shifted as in the moving face. "
        "One trial represents each instruction."
    )
    return _drawn(results, "faces", "Faces", text, lambda: study_faces(faces, body))


def choices_figure(results: Results, effects: xr.Dataset) -> list[Drawn]:
    """Draw the effects of the varied choices."""
    text = (
        "Change of rho caused by each varied choice, with all other choices at their reference, for "
        "each strategy: mean over volunteers with its interval. Open symbols: not significant "
        "after Holm's correction over all changes."
    )
    return _drawn(results, "choices", "Open choices", text, lambda: sensitivity_plot(effects))


def trial_figures(results: Results) -> list[Drawn]:
    """Draw one trial from signal to score, and the features of all trials."""
    if results.laboratory is None or results.intake is None or results.study is None:
        return []
    chosen = representative(results.base)
    if not chosen:
        return []
    place = next(iter(chosen.values()))
    where = {"volunteer": place[0], "instruction": place[1], "repetition": place[2]}
    status = results.base["status"].sel(where)
    strategy = str(status["strategy"].values[int(np.argmax(status.values == "ok"))])
    try:
        trial = results.trial(place, strategy)
    except FAILURES as error:
        label = " ".join(map(str, where.values()))
        results.notes.append(f"The pictures of trial {label} are omitted: {error}")
        return []
    drawn: list[Drawn] = []
    if results.study.activation_source == "estimated":
        drawn += _drawn(
            results,
            "emg",
            "Signals and features",
            f"Trial {trial.label}: sEMG of the left side as recorded and filtered, and the "
            "feature before normalisation.",
            lambda: _emg(results, trial),
        )
        drawn += _features(results)
        drawn += _differences(results)
    drawn += _drawn(
        results,
        "activation",
        "Activation",
        f"Trial {trial.label}: activation of every muscle over time.",
        lambda: activation_heat_map(trial.activation),
    )
    drawn += _drawn(
        results,
        "alignment",
        "Synchronisation",
        f"Trial {trial.label}: first principal components of measured and simulated motion before "
        "and after alignment, after Fig. 3 of Eskes et al. 2017.",
        lambda: synchronisation(trial.aligned),
    )
    drawn += _drawn(
        results,
        "traces",
        "Markers",
        f"Trial {trial.label}: displacement of every marker along x, y and z, measured (aligned) "
        "and simulated.",
        lambda: marker_traces(trial.aligned, trial.motion, trial.scores),
    )
    return drawn


def _emg(results: Results, trial: ReportedTrial) -> Figure:
    assert results.study is not None
    recording, chain = trial.recording.dataset, results.study.signals
    filtered = bandpass(recording["emg"], chain.filter)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FeatureWarning)
        feature = feature_of(filtered, chain.feature)
    known = [str(name) for name in recording["channel"].values]
    return emg_with_features(
        recording["emg"],
        filtered,
        feature,
        channels=[name for name in CHANNELS_SHOWN if name in known],
        origin=origin_of(recording),
        label=" ".join(map(str, trial.place)),
    )


def _features(results: Results) -> list[Drawn]:
    assert (
        results.study is not None and results.intake is not None and results.laboratory is not None
    )
    strategy = "act_all" if "act_all" in results.study.strategies else results.study.strategies[0]
    activations: list[xr.Dataset] = []
    for recording in results.intake.recordings:
        if recording.error is not None or recording.excluded:
            continue
        try:
            activations.append(results.activation(recording, strategy))
        except FAILURES:  # the trial is in the list of exclusions
            continue
    if not activations:
        return []
    text = (
        f"Activation of every muscle with {strategy}, over all samples of all trials of an instruction, "
        "after Fig. 5 of Eskes et al. 2017. Whiskers span the 5th to 95th percentile."
    )
    text = " ".join([text, *mute_muscles(results)])
    return _drawn(
        results,
        "features",
        "Features per muscle",
        text,
        lambda: feature_boxes(activations, labels=INSTRUCTIONS),
    )


def mute_muscles(results: Results) -> list[str]:
    """Sentences on muscles whose feature is zero or saturated throughout, with a threshold to try."""
    assert results.study is not None and results.intake is not None
    mute: dict[str, list[tuple[str, str]]] = {}
    for recording in results.intake.recordings:
        if recording.error is not None or recording.excluded:
            continue
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                feature_before_normalisation(recording.dataset, results.study.signals)
            except FAILURES:
                continue
        for one in caught:
            if isinstance(one.message, MuteFeature):
                trial = " ".join(map(str, recording.place))
                mute.setdefault(one.message.name, []).append((trial, one.message.state))
    return [
        f"{name} contains no information in {_trials([trial for trial, _ in rows])}: its Willison "
        f"amplitude is {rows[0][1]}."
        for name, rows in sorted(mute.items())
    ]


def _trials(names: list[str]) -> str:
    return f"trial {names[0]}" if len(names) == 1 else f"{len(names)} trials, such as {names[0]}"


def _differences(results: Results) -> list[Drawn]:
    """Compare the activations that follow the markers with those of the first strategy from sEMG."""
    assert results.study is not None and results.intake is not None
    strategies = results.study.strategies
    by_markers = [name for name in strategies if name in VARIANT]
    by_emg = [name for name in strategies if name not in VARIANT]
    if not by_markers or not by_emg:
        return []
    pairs: dict[str, list[tuple[xr.Dataset, xr.Dataset]]] = {name: [] for name in by_markers}
    for recording in results.intake.recordings:
        if recording.error is not None or recording.excluded:
            continue
        for name in by_markers:
            try:
                one, other = (results.activation(recording, s) for s in (name, by_emg[0]))
            except FAILURES:  # the trial is in the list of exclusions
                continue
            pairs[name].append((one, other))
    text = (
        f"Activations of {' and '.join(by_markers)}, which follow all markers, compared with "
        f"{by_emg[0]} in every muscle and instruction (means over the trials). Mean difference: "
        "purple is lower, orange is higher. Correlation over time: purple is opposite, orange is "
        "equal, and grey means that one of the two activations does not change. The scale of "
        "activations from sEMG depends on their normalisation; a difference in size is therefore "
        "not a finding by itself."
    )
    title = "Where activations disagree"
    return _drawn(results, "differences", title, text, lambda: difference_map(pairs))


def _drawn(
    results: Results, name: str, title: str, caption: str, draw: Callable[[], Any]
) -> list[Drawn]:
    """Draw a figure; after a failure, which is noted, the page is written without it."""
    try:
        figure = draw()
    except AnalysisError as error:
        results.notes.append(f"The figure '{title}' is omitted: {error}")
        return []
    description = f"{title_of(figure)}. {caption}"
    return [Drawn(name, title, caption, svg_of(figure, name, description, scale=FIGURE_SCALE))]
