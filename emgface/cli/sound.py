"""``emgface sound``: formants and sound of the vocal tract."""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from emgface.cli.console import Rows, frame, progress, say, show_table
from emgface.cli.options import FacePath

if TYPE_CHECKING:
    import xarray as xr

app = typer.Typer(no_args_is_help=True, help="Formants and sound of the vocal tract.")

AreasOption = Annotated[
    Path | None,
    typer.Option("--areas", help="Area function (CSV: A0_cm2, A1_cm2, ..., length_m; netCDF)."),
]
VowelOption = Annotated[
    str, typer.Option(help="Idealised vowel where no areas are given: a, i or u.")
]
RowOption = Annotated[str | None, typer.Option(help="Label or index of the row of the table.")]
FromLipsOption = Annotated[
    bool, typer.Option("--from-lips", help="The table lists areas from the lips to the glottis.")
]
NetcdfOption = Annotated[Path | None, typer.Option("--nc", help="Results to write (netCDF).")]
PlotOption = Annotated[Path | None, typer.Option(help="Picture to write (png, pdf, svg).")]
SourceOption = Annotated[
    str, typer.Option(help="Source: folds, rosenberg, or a wave file with the flow of the glottis.")
]
LungOption = Annotated[float, typer.Option(help="Lung pressure of the folds [Pa].")]
TensionOption = Annotated[float, typer.Option(help="Tension of the folds, about 0.5 to 2.")]
PitchOption = Annotated[float, typer.Option(help="Pitch of the source rosenberg [Hz].")]
RateOption = Annotated[int, typer.Option(help="Samples per second [Hz].")]
NoiseOption = Annotated[bool, typer.Option(help="Turbulence noise.")]
SeedOption = Annotated[int, typer.Option(help="Seed of the noise.")]


@app.command()
def formants(
    areas: AreasOption = None,
    row: RowOption = None,
    from_lips: FromLipsOption = False,
    vowel: VowelOption = "u",
    out_path: NetcdfOption = None,
    plot: PlotOption = None,
) -> None:
    """Compute the formants of an area function."""
    from emgface.anatomy.airway.sound import with_formants

    _finish(with_formants(_tract(areas, row, from_lips, vowel)), out_path, plot, "formants")


@app.command()
def synthesise(
    wave: Annotated[Path, typer.Option("--out", help="Wave file to write.")],
    areas: AreasOption = None,
    row: RowOption = None,
    from_lips: FromLipsOption = False,
    vowel: VowelOption = "u",
    source: SourceOption = "folds",
    duration: Annotated[float | None, typer.Option(help="Duration in s.")] = None,
    rate: RateOption = 44_100,
    lung: LungOption = 785.0,
    tension: TensionOption = 1.0,
    pitch: PitchOption = 120.0,
    noise: NoiseOption = True,
    seed: SeedOption = 0,
    out_path: NetcdfOption = None,
    plot: PlotOption = None,
) -> None:
    """Simulate the sound of an area function and write it as a wave file."""
    from emgface.anatomy.airway.sound import synthesise as compute
    from emgface.anatomy.airway.sound import with_formants, write_wave

    tract = with_formants(_tract(areas, row, from_lips, vowel))
    with progress("simulating") as bar:
        sound = compute(
            tract, source, duration=duration, rate=rate, lung=lung, tension=tension, pitch=pitch,
            noise=noise, seed=seed, progress=bar.show,
        )  # fmt: skip
    write_wave(sound, wave)
    _finish(sound, out_path, plot, f"sound of {source}", wave)


@app.command()
def trial(
    trajectory: Annotated[Path, typer.Argument(help="Trajectory of 'emgface simulate'.")],
    wave: Annotated[Path | None, typer.Option("--out", help="Wave file to write.")] = None,
    areas: AreasOption = None,
    row: RowOption = None,
    from_lips: FromLipsOption = False,
    vowel: VowelOption = "u",
    source: SourceOption = "folds",
    lung: LungOption = 785.0,
    tension: TensionOption = 1.0,
    out_path: NetcdfOption = None,
    plot: PlotOption = None,
) -> None:
    """Compute formants and sound of a simulated motion; only the lips move."""
    from emgface.anatomy.airway.area_function import lips_of_trial, with_lips
    from emgface.anatomy.airway.sound import with_formants
    from emgface.schema.netcdf import read_netcdf

    lips = lips_of_trial(read_netcdf(trajectory, "trajectory"))
    sound = with_formants(with_lips(_tract(areas, row, from_lips, vowel), *lips))
    _sounding(sound, wave, source, lung, tension, out_path, plot, "lips before a fixed tract")


@app.command()
def head(
    path: Annotated[Path, typer.Argument(metavar="HEAD", help="Head of 'emgface build head'.")],
    motion: Annotated[
        Path | None, typer.Option(help="Motion of this head by 'emgface simulate'.")
    ] = None,
    wave: Annotated[Path | None, typer.Option("--out", help="Wave file to write.")] = None,
    source: SourceOption = "folds",
    lung: LungOption = 785.0,
    tension: TensionOption = 1.0,
    out_path: NetcdfOption = None,
    plot: PlotOption = None,
) -> None:
    """Compute area function, formants and sound of a head with face, jaw and tongue."""
    from emgface.anatomy.airway.head import head_tract
    from emgface.anatomy.airway.sound import with_formants
    from emgface.anatomy.head.model import read_head
    from emgface.anatomy.head.run import read_motion

    moving = None if motion is None else read_motion(motion)[0]
    sound = with_formants(head_tract(read_head(path), moving))
    _sounding(sound, wave, source, lung, tension, out_path, plot, f"tract of {path.name}")


@app.command()
def areas(
    surface: Annotated[Path, typer.Argument(help="Surface of an airway (obj, triangles).")],
    start: Annotated[
        tuple[float, float, float],
        typer.Option(metavar="X Y Z", help="Point at the glottis, in the unit of the file."),
    ],
    out_path: Annotated[Path, typer.Option("--out", help="Area function to write (netCDF).")],
    end: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="X Y Z", help="Point at the lips; default: the farthest point."),
    ] = None,
    unit: Annotated[str, typer.Option(help="Unit of the file: m, cm or mm.")] = "m",
    sections: Annotated[int, typer.Option(min=2, help="Number of sections.")] = 40,
    plot: PlotOption = None,
) -> None:
    """Compute the area function of a surface along its centre line, and its formants."""
    from emgface.anatomy.airway.area_function import areas_of_surface
    from emgface.anatomy.airway.sound import with_formants

    tract = areas_of_surface(surface, start, end=end, unit=unit, count=sections)
    _finish(with_formants(tract), out_path, plot, f"area function of {surface.name}")


@app.command()
def muscles(
    face: FacePath = None,
    areas: AreasOption = None,
    row: RowOption = None,
    from_lips: FromLipsOption = False,
    vowel: VowelOption = "u",
    activation: Annotated[
        float, typer.Option(min=0.001, max=1.0, help="Activation of both muscles of a pair.")
    ] = 0.1,
    out_table: Annotated[Path | None, typer.Option("--out", help="Table to write (CSV).")] = None,
) -> None:
    """Compute the change of lips and formants per activation of every muscle pair, from rest."""
    from emgface.anatomy.airway.muscles import formants_by_muscle
    from emgface.api.given import face_of, study_of

    tract = _tract(areas, row, from_lips, vowel)
    by_muscle = formants_by_muscle(face_of(face, study_of(None)), tract, activation=activation)
    units = {"area": "area [mm2]", "protrusion": "protrusion [mm]"}
    table = by_muscle.rename(columns=lambda name: units.get(name, f"{name} [Hz]")).round(3)
    if out_table is not None:
        from emgface.files import replace_file

        replace_file(out_table, lambda path: table.to_csv(path))
        say(f"Wrote {out_table}.")
    show_table(frame(table), "at rest, and changes per activation of 1 (simulated)")
    say(f"Assumptions: {tract.attrs['assumptions']}.")


def _sounding(
    tract: "xr.Dataset",
    wave: Path | None,
    source: str,
    lung: float,
    tension: float,
    out_path: Path | None,
    plot: Path | None,
    title: str,
) -> None:
    """Simulate the sound of a moving tract if it is wanted, and write and print the results."""
    from emgface.anatomy.airway.sound import synthesise as compute
    from emgface.anatomy.airway.sound import write_wave

    if wave is not None:
        with progress("simulating") as bar:
            tract = compute(tract, source, lung=lung, tension=tension, progress=bar.show)
        write_wave(tract, wave)
    _finish(tract, out_path, plot, title, wave)


def _tract(areas: Path | None, row: str | None, from_lips: bool, vowel: str) -> "xr.Dataset":
    from emgface.anatomy.airway.area_function import tract_of
    from emgface.anatomy.airway.parameters import TractParameters
    from emgface.choices import configure

    given = configure(TractParameters, {"vowel": vowel, "areas": areas})
    return tract_of(given, row, from_lips=from_lips)


def _finish(
    data: "xr.Dataset",
    out_path: Path | None,
    plot: Path | None,
    title: str,
    wave: Path | None = None,
) -> None:
    from emgface.anatomy.airway.sound import sample_rate, sound_doubts
    from emgface.schema.netcdf import write_netcdf

    if wave is not None:
        say(
            f"Wrote {wave}: simulated, {sample_rate(data)} Hz, 16 bit, 1.0 is "
            f"{data.attrs['full_scale']:.3g} Pa at {data.attrs['distance']:g} m from the lips."
        )
    if out_path is not None:
        say(f"Wrote {write_netcdf(data, out_path, 'sound')}.")
    if plot is not None:
        from emgface.anatomy.airway.figure import write_sound_figure

        say(f"Wrote {write_sound_figure(data, plot, title)}.")
    values = data["formant_frequency"].values, data["formant_bandwidth"].values
    chosen = sorted({0, len(data["time"]) // 2, len(data["time"]) - 1})
    cells = [
        (f"{float(data['time'][k]):.3f}", f"F{n + 1}", f"{f:.0f}", f"{b:.0f}")
        for k in chosen
        for n, (f, b) in enumerate(zip(values[0][k], values[1][k], strict=True))
        if f == f
    ]
    show_table(
        Rows(("time [s]", "formant", "frequency [Hz]", "bandwidth [Hz]"), tuple(cells)), title
    )
    say(f"Assumptions: {data.attrs['assumptions']}.")
    for text in sound_doubts(data):
        warnings.warn(text, stacklevel=1)
