"""``emgface activate``, ``simulate``, ``score``: the stages of one trial, one by one."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from emgface.cli.chain import (
    BandOption,
    FeatureOption,
    MissingMuscleOption,
    MissingSideOption,
)
from emgface.cli.console import progress, say, show_table
from emgface.cli.machine import announce_compilation
from emgface.cli.study import AccuracyOption

if TYPE_CHECKING:
    import xarray as xr

StudyPath = Annotated[
    Path | None, typer.Option("--study", help="Study file whose parameters apply.")
]
FacePath = Annotated[
    Path | None, typer.Option("--face", help="Face model; that of the study, or the template.")
]


def activate(
    recording: Annotated[Path, typer.Argument(help="Recording of one trial.")],
    out_path: Annotated[Path, typer.Option("--out", help="Activation to write (netCDF).")],
    strategy: Annotated[
        str | None, typer.Option(help="act_all, act_3, act_rel, act_threshold, or true.")
    ] = None,
    instruction: Annotated[str | None, typer.Option(help="A to F, if not recorded.")] = None,
    mapping: Annotated[
        Path | None, typer.Option(help="TOML file that maps labels of the file to names.")
    ] = None,
    study: StudyPath = None,
    band: BandOption = None,
    feature: FeatureOption = None,
    missing_side: MissingSideOption = None,
    missing_muscle: MissingMuscleOption = None,
    plot: Annotated[Path | None, typer.Option(help="Picture of the activations.")] = None,
) -> None:
    """Compute muscle activations from the sEMG of a recording."""
    import emgface as ef
    from emgface.cli.tables import activation_rows, draw_activation
    from emgface.schema.netcdf import write_netcdf

    activation = ef.activate(
        recording,
        strategy=strategy,
        instruction=instruction,
        mapping=mapping,
        study=study,
        band=band,
        feature=feature,
        missing_side=missing_side,
        missing_muscle=missing_muscle,
    )
    write_netcdf(activation, out_path, "activation")
    show_table(activation_rows(activation), f"{recording.name}, {activation.attrs['origin']}")
    if montage := activation.attrs.get("montage"):
        say(f"Montage: {montage}.")
    if plot is not None:
        draw_activation(activation, plot)
        say(f"Wrote {plot}.")
    say(f"Wrote {out_path}.")


def simulate(
    activation: Annotated[Path, typer.Argument(help="Activation as written by 'activate'.")],
    out_path: Annotated[Path, typer.Option("--out", help="Trajectory to write (netCDF).")],
    face: FacePath = None,
    study: StudyPath = None,
    sigma_max: Annotated[
        float | None, typer.Option(help="Largest muscle stress at the start [Pa].")
    ] = None,
    solver: Annotated[
        str | None,
        typer.Option(
            help="sdirk2, converged, trapezoidal, linearly_implicit or linearly_implicit_trapezoidal."
        ),
    ] = None,
    accuracy: AccuracyOption = None,
) -> None:
    """Move the face by an activation."""
    from emgface.choices import configure
    from emgface.face.motion import settle_face, simulate_face
    from emgface.face.simulation_parameters import SimulationParameters
    from emgface.face.stability import stability_warning
    from emgface.schema.netcdf import read_netcdf, write_netcdf
    from emgface.study.configuration import FaceConfiguration, StudyConfiguration
    from emgface.study.faces import study_face
    from emgface.study.file import load_study
    from emgface.study.policy import lower_sigma_max

    configuration = load_study(study) if study else StudyConfiguration()
    base = configuration.simulation
    base = base if accuracy is None else base.as_accurate(accuracy)
    given = {"sigma_max": sigma_max, "solver": solver}
    changes: dict[str, object] = {name: v for name, v in given.items() if v is not None}
    if accuracy is None and str(solver).startswith("linearly_implicit"):
        changes["error_tolerance"] = None  # schemes of one solution do not control their error
    parameters = configure(SimulationParameters, base.model_dump() | changes, where="simulation")
    drive = read_netcdf(activation, "activation")
    where = FaceConfiguration(path=face) if face else configuration.face
    model = study_face(where)
    announce_compilation()
    with progress("simulating") as bar:

        def once(parameters: SimulationParameters) -> "xr.Dataset":
            bar.working("settling under gravity")
            settled = settle_face(model, parameters)
            bar.working(f"simulating, sigma_max {parameters.sigma_max / 1e3:.4g} kPa")
            return simulate_face(
                model, drive["activation"], parameters, settled=settled, progress=bar.show
            )

        trajectory = lower_sigma_max(once, parameters, report=bar.message)
    keep = ("volunteer", "instruction", "repetition", "strategy", "montage")
    trajectory.attrs |= {name: drive.attrs[name] for name in keep if name in drive.attrs}
    write_netcdf(trajectory, out_path, "trajectory")
    moved = 1e3 * trajectory.attrs["motion"]
    say(
        f"Wrote {out_path}: {int(trajectory['steps'].sum())} steps in "
        f"{trajectory.attrs['run_time_s']:.1f} s, sigma_max "
        f"{trajectory.attrs['sigma_max'] / 1e3:.4g} kPa, smallest J "
        f"{float(trajectory['smallest_J'].min()):.2g}, largest marker displacement "
        f"{moved:.2f} mm."
    )
    if warning := stability_warning(trajectory):
        say(f"Warning: {warning}.")
    if "numerical_error" not in trajectory.attrs:
        say(f"The error of the time steps is not estimated by solver = '{parameters.solver}'.")
        return
    error = 1e3 * trajectory.attrs["numerical_error"]
    share = f", {100 * error / moved:.2g} % of the motion" if moved > 0.0 else ""
    told = f"Estimated error of the time steps: {error:.2g} mm{share}."
    if trajectory.attrs["inaccurate"]:
        told += " It exceeds a tenth of the motion: ask for an --accuracy such as '0.1 mm'."
    say(told)


def score(
    recording: Annotated[Path, typer.Argument(help="Recording of the trial.")],
    trajectory: Annotated[Path, typer.Argument(help="Trajectory as written by 'simulate'.")],
    out_path: Annotated[Path, typer.Option("--out", help="Scores to write (netCDF).")],
    face: FacePath = None,
    study: StudyPath = None,
    mapping: Annotated[
        Path | None, typer.Option(help="TOML file that maps labels of the file to names.")
    ] = None,
) -> None:
    """Align measured with simulated lip motion and score every marker."""
    import emgface as ef
    from analysis.flags import FLAGS, flags_of
    from emgface.cli.tables import score_rows
    from emgface.schema.netcdf import write_netcdf

    scores = ef.score(recording, trajectory, face=face, study=study, mapping=mapping)
    write_netcdf(scores, out_path, "scores")
    title = f"{recording.name} ({scores.attrs['origin']}), shift {float(scores['shift']):.3f} s"
    show_table(score_rows(scores), title)
    for name in flags_of(scores):
        say(f"Flag {name}: {FLAGS[name]}.")
    say(f"Wrote {out_path}.")
