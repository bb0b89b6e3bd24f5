"""Options common to several commands."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from emgface.signals.parameters import SignalChain

OutPath = Annotated[
    Path | None, typer.Option("--out", help="File to write; by default the text is printed.")
]
ReplaceOption = Annotated[
    bool, typer.Option("--force", help="Write files again that exist; default: refuse.")
]
MappingOption = Annotated[
    Path | None,
    typer.Option(
        help="TOML file that maps labels of a recording to names, or a pattern of file names such as "
        "'{volunteer}_{instruction}_{repetition}.c3d'."
    ),
]
StudyPath = Annotated[
    Path | None, typer.Option("--study", help="Study file that specifies the parameters.")
]
FacePath = Annotated[
    Path | None,
    typer.Option("--face", help="Face model; default: the face of the study, or the template."),
]
ModelPath = Annotated[
    Path | None,
    typer.Option(
        "--model",
        "--face",
        help="Face, jaw, tongue or head; default: the face of the study, or the template.",
    ),
]


def stress(text: str) -> float:
    """Stress [Pa], or the published start by its name."""
    from emgface.face.muscle_parameters import PUBLISHED_START

    if text == "published":
        return PUBLISHED_START
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(
            f"{text!r}: expected a stress in Pa such as 100e3, or published (300e3)"
        ) from None


SigmaMaxOption = Annotated[
    float | None,
    typer.Option(
        parser=stress,
        metavar="<Pa>",
        help="Largest muscle stress at the start [Pa]; 'published' is 300e3, the default.",
    ),
]
AccuracyOption = Annotated[
    str | None,
    typer.Option(
        help="draft, study, reference, published, or the desired error, such as '0.1 mm'."
    ),
]
WorkersOption = Annotated[
    int | None,
    typer.Option(min=1, help="Number of simultaneous simulations; default: one per core."),
]
SchedulerOption = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="dask.distributed scheduler whose workers compute, such as tcp://host:8786, or the file "
        "of 'dask scheduler --scheduler-file'; they must share the folder of the results.",
    ),
]
InstructionOption = Annotated[
    str | None, typer.Option(help="Instruction A to F, if the recording does not specify it.")
]
ContactSwitch = Annotated[
    bool, typer.Option(help="Contact of lips and teeth as in the study, or none.")
]
ClipOption = Annotated[
    bool, typer.Option("--clip", help="Limit activations that exceed the range to 0-1.")
]
ReferenceOption = Annotated[
    list[Path] | None,
    typer.Option(
        help="Recording of maximum effort, whose range is used for the normalisation; repeatable."
    ),
]
BaselineOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--baseline",
        help="Motion of a jaw by other excitations, such as those of exchanged channels, that is also "
        "scored; repeatable.",
    ),
]
PresetOption = Annotated[
    str, typer.Option(help="adult, woman, man, older_woman, older_man, girl or boy.")
]
MeasureOption = Annotated[
    list[str] | None,
    typer.Option("--set", help="Measure of the person, such as mouth_width=52mm; repeatable."),
]
SettingOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Setting of the kind of model, such as law=hill or gravity=false; of a face, a parameter "
        "of the table simulation of a study file, such as contact.method=none. Repeatable.",
    ),
]
GravityOption = Annotated[bool, typer.Option(help="Simulate gravity.")]
SeedOption = Annotated[
    int | None,
    typer.Option(
        min=0,
        help="Seed for drawing a random person of the group; default: the means of the group.",
    ),
]
ResolutionOption = Annotated[
    str, typer.Option(help="coarse, medium, fine, or the approximate number of elements.")
]
BandOption = Annotated[
    tuple[float, float] | None,
    typer.Option(
        metavar="LOW HIGH",
        help="Pass-band [Hz] instead of that of the signal chain, for example 20 400.",
    ),
]
FeatureOption = Annotated[
    str | None, typer.Option(help="Amplitude feature: wamp, rms, mav or envelope.")
]
MissingSideOption = Annotated[
    str | None,
    typer.Option(
        help="Treatment of a channel recorded on the other side only: mirror, zero or leave_out."
    ),
]
MissingMuscleOption = Annotated[
    str | None,
    typer.Option(help="Treatment of a channel recorded on neither side: zero or leave_out."),
]


def mesh_size(resolution: str) -> str | int:
    """Name of a resolution, or a number of elements."""
    return int(resolution) if resolution.isdecimal() else resolution


def chain_with(
    chain: "SignalChain",
    *,
    band: tuple[float, float] | None = None,
    feature: str | None = None,
    missing_side: str | None = None,
    missing_muscle: str | None = None,
) -> "SignalChain":
    """Return the signal chain with the parameters replaced by command options."""
    from emgface.choices import configure
    from emgface.signals.parameters import SignalChain

    low, high = band or (None, None)
    given: dict[str, dict[str, Any]] = {
        "filter": {"low": low, "high": high},
        "feature": {"kind": feature},
        "montage": {"missing_side": missing_side, "missing_muscle": missing_muscle},
    }
    values = chain.model_dump()
    for stage, options in given.items():
        values[stage] |= {name: value for name, value in options.items() if value is not None}
    return configure(SignalChain, values, where="options")
