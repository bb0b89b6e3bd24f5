"""Methods of a study from its configuration, and table of all parameters."""

from typing import Any

import xarray as xr

from analysis.statistics.scope import LEAST_INSTRUCTIONS, LEAST_VOLUNTEERS
from emgface.choices import parameter_table
from emgface.face.event_error import contact_statement
from emgface.inverse.configuration import VARIANT
from emgface.signals.montage import COMPLETE
from emgface.study.configuration import StudyConfiguration

FEATURES = {
    "wamp": "Willison amplitude",
    "rms": "root mean square",
    "mav": "mean absolute value",
    "envelope": "linear envelope with the neural transfer function of Buchanan et al. (2004)",
}
STAGE_WORDS = {
    "signal": "filtered signals",
    "feature": "features",
    "activation": "normalised features",
}
VOLUMES = {
    "pointwise": "at each Gauss point",
    "element": "of each element",
    "nodal": "of the region of each node",
}
TANGENTS = {
    "current": "current tangent stiffness",
    "passive": "current tangent stiffness without activation",
    "rest": "stiffness at rest",
}
INTEGRATOR_WORDS = {
    "converged": "the implicit Euler method, each step iterated until it converged,",
    "trapezoidal": "the trapezoidal rule, each step iterated until it converged,",
    "sdirk2": "the second-order L-stable SDIRK method, each stage iterated until it converged,",
    "linearly_implicit": "the implicit Euler method, with one linear solution per step,",
    "linearly_implicit_trapezoidal": "the trapezoidal rule, with one linear solution per step,",
}
REACHES = {
    "trial": "over each trial",
    "session": "over all trials of a volunteer",
    "reference": "over a maximum-effort recording of each volunteer",
}


def methods(study: StudyConfiguration, cube: xr.Dataset) -> str:
    """Write the methods of a manuscript, in the past tense and the units of the field.

    Paragraphs on recordings, signals, mechanics, and scores with their comparison are separated by an
    empty line.
    """
    paragraphs = (
        _recordings(study, cube),
        _signals(study, cube),
        _mechanics(study, cube),
        [*_scores(study), *_comparison(cube)],
    )
    return "\n\n".join(" ".join(part) for part in paragraphs if part)


def _recordings(study: StudyConfiguration, cube: xr.Dataset) -> list[str]:
    origin = str(cube.attrs["origin"])
    count = {dim: cube.sizes[dim] for dim in ("volunteer", "instruction", "repetition")}
    text = ", ".join(f"{n} {dim}{'s' if n != 1 else ''}" for dim, n in count.items())
    sentences = [f"The {origin} recordings comprise {text}."]
    if origin == "simulated":
        world = f", in the {cube.attrs['world']}" if cube.attrs.get("world") else ""
        sentences.append(f"No person was recorded: sEMG and marker motion were simulated{world}.")
    head = study.signals.head_frame
    sentences.append(
        "The rigid motion of the head was removed by a least-squares fit of the six face markers; "
        f"gaps of up to {1e3 * head.max_gap:g} ms in the positions of a marker were interpolated."
    )
    return sentences


def _signals(study: StudyConfiguration, cube: xr.Dataset) -> list[str]:
    if study.activation_source == "true":
        return ["The face was driven by the true activation of the simulated recordings."]
    chain = study.signals
    way = "forward and backward" if chain.filter.phase == "zero" else "forward only"
    sentences = [
        f"Surface EMG was band-pass filtered from {chain.filter.low:g} to {chain.filter.high:g} Hz "
        f"(Butterworth, design order {chain.filter.order}, {way})."
    ]
    feature = chain.feature
    text = f"Its amplitude was computed as the {FEATURES[feature.kind]}"
    if feature.kind != "envelope":
        text += (
            f" in windows of {1e3 * feature.window:g} ms, each at the time of its {feature.label}"
        )
    if feature.kind == "wamp":
        over = (
            f"{1e6 * feature.threshold:g} µV"
            if feature.threshold is not None
            else f"{feature.threshold_baseline:g} times the baseline"
        )
        text += f", with a threshold of {over}"
    sentences.append(f"{text}.")
    montage = str(cube.attrs.get("montage", COMPLETE.sentence))
    complete = montage == COMPLETE.sentence
    oom = "with the weights given in the text" if chain.mapping.oom == "text" else "as printed"
    sentences.append(
        "The activity of ten muscles per side was derived from the "
        f"{STAGE_WORDS[chain.mapping.mapping_stage]} of {'seven' if complete else 'up to seven'} "
        f"electrodes per side (Eqs 2-6 of Eskes et al. 2017, Eq. 3 {oom})."
    )
    if not complete:
        sentences.append(f"Channels: {montage}.")
    sentences.append(
        f"Features were scaled to 0-1 by their minimum and maximum {REACHES[chain.normalisation.reach]}."
    )
    sentences.append(f"The activation strategies were {', '.join(study.strategies)}.")
    followed = [name for name in study.strategies if name in VARIANT]
    if followed:
        sentences.append(
            f"With {' and '.join(followed)}, the activations were estimated from the measured markers"
            f"{' and the sEMG' if followed == ['assisted'] else ''} (inverse tracking without contact, "
            f"form {study.inverse.form!r}). Each pair of markers was scored in a simulation with "
            "activations that were estimated without this pair."
        )
    sampling = chain.resampling
    if sampling.steps is not None:
        sentences.append(f"Each trial was resampled to {sampling.steps} equal steps.")
    elif sampling.period is not None:
        sentences.append(f"Each trial was resampled every {1e3 * sampling.period:g} ms.")
    return sentences


def _mechanics(study: StudyConfiguration, cube: xr.Dataset) -> list[str]:
    s = study.simulation
    face = str(cube.attrs.get("face", "unnamed"))
    kind = str(cube.attrs.get("face_origin", "of unstated origin"))
    if s.incompressibility == "hard":
        volume = "constant volume of every element"
    else:
        bulk = "(ln J)²" if s.bulk_potential == "logarithmic" else "(J - 1)²"
        where = VOLUMES[s.incompressibility]
        volume = f"kappa = {s.kappa / 1e3:g} kPa, potential kappa/2 {bulk} {where}"
    sentences = [
        f"The face model ({face}, {kind}) consisted of Mooney-Rivlin tissue (C10 = {s.C10:g} Pa, "
        f"C20 = {s.C20:g} Pa, {volume}; density {s.density:g} kg/m³). Rayleigh damping "
        f"(alpha = {s.alpha:g} 1/s, beta = {s.beta:g} s, {TANGENTS[s.damping_tangent]}) was included, "
        f"and gravity was {'included' if s.gravity else 'neglected'}."
    ]
    policy = (
        f"sigma_max was initially {s.sigma_max / 1e3:g} kPa and was multiplied by "
        f"{s.sigma_max_policy.factor:g} after each simulation that failed"
    )
    if s.sigma_max_policy.calibration != "none":
        policy = (
            "sigma_max was calibrated for each volunteer, repetition and strategy by the amplitude of "
            "the markers in the volunteer's other repetitions"
        )
    if s.muscle_form == "lines":
        sentences.append(
            f"Muscles were modelled as lines that each exert {s.line_force:g} N at full activation."
        )
    elif s.fibre_law == "blemker":
        sentences.append(f"Muscle fibres followed the law of Blemker et al. 2005; {policy}.")
    else:
        sentences.append(
            f"The active stress of muscle fibres did not depend on their length; {policy}."
        )
    own = [
        ("separate properties of the skin", s.skin != type(s.skin)()),
        (f"prestress ({s.prestress.method})", s.prestress != type(s.prestress)()),
        (f"support of {s.support:g} N/m behind the lips", s.support > 0),
        (s.contact.methods_phrase(s.solver), s.contact.method != "none"),
        (f"stiffening of active muscles by a factor of {s.stiffening:g}", s.stiffening > 1),
    ]
    if further := [text for text, used in own if used]:
        sentences.append(
            f"The model included {', '.join(further)}; details are given in the table of parameters."
        )
    sentences += [f"The tissue of {tissue}." for tissue in s.tissues]
    control = (
        f" that divided {1e3 * s.step:g} ms and were chosen by error control with a tolerance of "
        f"{1e3 * s.error_tolerance:g} mm at the lip markers"
        if s.error_tolerance is not None
        else f" of {1e3 * s.step:g} ms"
    )
    sentences.append(f"Motion was integrated by {INTEGRATOR_WORDS[s.solver]} in steps{control}.")
    full_order = s.reduced.file is None or s.reduced.fall_back
    if s.contact.method != "none" and full_order:
        sentences.append(f"{contact_statement(s.solver, repeated=s.check_contact)}.")
    if s.reduced.file is not None:
        otherwise = "at full order" if s.reduced.fall_back else "with the reduced face as well"
        sentences.append(
            "A reduced face was simulated instead, in linearly implicit Euler steps of "
            f"{1e3 * s.step:g} ms, where its error bound was at most "
            f"{1e3 * s.reduced.largest_error:g} mm and the activation was within the range of its "
            f"training. All other motions were computed {otherwise}."
        )
    return sentences


def _scores(study: StudyConfiguration) -> list[str]:
    a = study.alignment
    scaling = {
        "length": "stretched to the simulated duration",
        "search": "stretched by a factor found by search",
        "none": "not stretched",
    }[a.scaling]
    sign = (
        "Where the absolute cosine between the components of both motions reached "
        f"{a.clear_cosine:g}, their arbitrary sign was chosen so that they pointed in the same "
        "direction; elsewhere, the sign with the larger correlation was chosen."
        if a.sign == "direction"
        else "Of the two arbitrary signs of a component, that with the larger correlation was chosen."
    )
    form = "with equal divisors" if study.score.form == "consistent" else "as printed"
    return [
        f"Measured marker motion was {scaling} and shifted to the maximum of the cross-correlation "
        "of the first principal components of both motions "
        f"({'centred' if a.centred else 'uncentred'} singular value decomposition, Eqs 9-10).",
        sign,
        "Each marker was scored by the 3D correlation of Pitermann and Munhall (Eqs 11-13, "
        f"{form}), the ratio of amplitudes and the root-mean-square distance.",
        "The noise of a marker was estimated from third differences of its positions. A "
        "marker was not scored if the variance of its motion was less than "
        f"{study.score.smallest_snr:g} times that of its noise. The expected attenuation of rho "
        "by noise is reported; rho itself is not corrected.",
    ]


def _comparison(cube: xr.Dataset) -> list[str]:
    if cube.sizes.get("strategy", 0) < 2 or cube.sizes["volunteer"] < 2:
        return []
    n = cube.sizes["instruction"]
    these = f"the {n} instructions recorded" if n > 1 else "the one instruction recorded"
    return [
        "Strategies were compared by Fisher's z of the correlation, paired within trial and "
        f"marker. For {these}, the comparison was a sign-flip permutation of the means of the "
        "volunteers. For instructions in general, it was a linear mixed model of the differences "
        "with crossed random slopes of volunteer and instruction (restricted maximum likelihood, "
        "degrees of freedom after Satterthwaite). Intervals were given if there were at least "
        f"{LEAST_VOLUNTEERS} volunteers and, for instructions in general, at least "
        f"{LEAST_INSTRUCTIONS} instructions."
    ]


def parameter_rows(study: StudyConfiguration) -> list[dict[str, Any]]:
    """List every parameter with value, default, unit, source, note and ``changed``.

    ``changed`` is True if the value differs from the default.
    """
    rows: list[dict[str, Any]] = []
    for record in parameter_table(study).to_dict("records"):
        row = {str(key): _shown(value) for key, value in record.items()}
        named = ("folder", "path", "mapping", "reduced.file")
        if str(record["parameter"]).endswith(named) and record["value"]:
            # A page may be passed on and should not contain paths of this machine.
            row["value"] = str(record["value"]).replace("\\", "/").rpartition("/")[2]
        rows.append({**row, "changed": row["value"] != row["default"]})
    return rows


def _shown(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, tuple | list):
        return ", ".join(map(_shown, value))
    return str(value)
