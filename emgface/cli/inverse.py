"""``emgface invert``: activations of all muscles from lip markers, with and without sEMG."""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from emgface.cli import options
from emgface.cli.console import BAD_INPUT, PARTIAL, Rows, progress, say, show_table
from emgface.cli.machine import announce_compilation, executing, graceful_stop

if TYPE_CHECKING:
    import xarray as xr

    from emgface.inverse.calibration import Calibration
    from emgface.inverse.parameters import InverseParameters
    from emgface.study.configuration import StudyConfiguration
    from sim.state import Array


@dataclass(frozen=True)
class _Inversion:
    """Face, calibration and options of `emgface invert run`, common to all of its recordings."""

    face: "xr.Dataset"
    plan: "StudyConfiguration"
    out: Path
    parameters: "InverseParameters"
    mapping: Path | None
    calibration: "Calibration | None"
    mixing: "Array | None"


MixingOption = Annotated[
    Path | None,
    typer.Option(help="CSV: share of every muscle (column) in the sEMG over another (row)."),
]
app = typer.Typer(no_args_is_help=True, help="Estimate activations from measured motion.")


@app.command()
def run(
    recordings: Annotated[
        list[Path], typer.Argument(help="Recordings of one trial each.", metavar="RECORDING...")
    ],
    out_files: Annotated[
        Path,
        typer.Option(
            "--out",
            help="Activation to write (netCDF), or the folder for those of several recordings.",
        ),
    ],
    face: options.FacePath = None,
    study: options.StudyPath = None,
    mapping: options.MappingOption = None,
    variant: Annotated[
        str, typer.Option(help="Use of the sEMG: assisted, hybrid, motion (none) or driven.")
    ] = "assisted",
    form: Annotated[
        str,
        typer.Option(
            help="trajectory: over the whole trial, with intervals; step: one time step after another; "
            "quasi_static: equilibria, for faces that move slowly."
        ),
    ] = "trajectory",
    calibration: Annotated[
        Path | None,
        typer.Option(help="Result of emgface invert calibrate; replaces gain and delay."),
    ] = None,
    mixing: MixingOption = None,
    emg_weight: Annotated[
        float, typer.Option(help="Weight of the sEMG in the assisted variant.")
    ] = 1.0,
    gain: Annotated[float, typer.Option(help="Factor on the normalised sEMG.")] = 1.0,
    delay: Annotated[
        float, typer.Option(help="Time by which the sEMG precedes the force in s.")
    ] = 0.04,
    leave_out: Annotated[
        list[str] | None, typer.Option(help="Lip marker that is not tracked; repeatable.")
    ] = None,
    contact: options.ContactSwitch = False,
    workers: options.WorkersOption = None,
    scheduler: options.SchedulerOption = None,
    force: Annotated[
        bool, typer.Option("--force", help="Compute the existing result of one recording again.")
    ] = False,
) -> None:
    """Estimate the activations of all muscles by which the face follows the lip markers.

    Several recordings are inverted at the same time, and a repeated command computes what is missing or
    whose inputs or code changed; `emgface study status` shows the state of their folder. An interrupted
    run of the trajectory form continues with its last complete iteration.
    """
    from emgface.api.given import face_of, study_of
    from emgface.inverse.calibration import Calibration
    from emgface.inverse.mixing import read_mixing
    from emgface.inverse.parameters import InverseParameters, form_of, without_contact
    from emgface.inverse.variants import trust_of
    from emgface.schema.netcdf import read_netcdf

    trust_of(variant, (), emg_weight)  # errors before the face is built
    form_of(form, contact)
    several = len(recordings) > 1
    if not several and out_files.exists() and not force:
        say(f"{out_files} exists and is kept: use --force to compute it again.")
        return
    plan = study_of(study)
    if not contact:
        plan = plan.model_copy(update={"simulation": without_contact(plan.simulation)})
    known = None
    if calibration is not None:
        known = Calibration(read_netcdf(calibration, "emg_calibration"))
    parameters = InverseParameters(
        variant=variant,  # pyright: ignore[reportArgumentType]  # checked above
        form=form,  # pyright: ignore[reportArgumentType]
        emg_weight=emg_weight,
        gain=gain,
        delay=delay,
        left_out=tuple(leave_out or ()),
    )
    known_mixing = None if mixing is None else read_mixing(mixing)
    given = _Inversion(
        face_of(face, plan), plan, out_files, parameters, mapping, known, known_mixing
    )
    announce_compilation()
    if several:
        _invert_all(recordings, given, workers, scheduler)
    else:
        _invert(recordings[0], given)


def _invert(path: Path, given: _Inversion) -> None:
    """Invert one recording in this process and report the result."""
    from emgface.api.given import recording_of
    from emgface.inverse.doubts import doubts
    from emgface.inverse.kept import Kept
    from emgface.inverse.run import invert
    from emgface.schema.netcdf import write_netcdf

    kept, data = Kept.for_result(given.out), recording_of(path, given.mapping)
    with progress("inverting") as bar:
        inverted = invert(
            data, given.face, given.plan.simulation, given.plan.signals, given.parameters,
            calibration=given.calibration, mixing=given.mixing, kept=kept, progress=bar.show,
        )  # fmt: skip
    write_netcdf(inverted, given.out, "activation")
    kept.remove()
    rms = 1e3 * float((inverted["misfit"] ** 2).mean()) ** 0.5
    say(
        f"Wrote {given.out}: {given.parameters.variant}, {inverted.sizes['time']} steps in "
        f"{inverted.attrs['run_time_s']:.1f} s, rms distance of the tracked markers {rms:.2f} mm per "
        f"coordinate ({inverted.attrs['misfit_ratio']:.0%} of their motion)."
    )
    if "interval" in inverted.attrs:
        width = float((inverted["activation_high"] - inverted["activation_low"]).mean())
        undetermined = inverted.attrs["undetermined"]
        say(
            f"Mean width of the {inverted.attrs['interval']:.0%} intervals {width:.2f}. "
            f"At the largest motion: {undetermined or 'every direction is determined by the data'}."
        )
    if given.parameters.variant != "motion" and inverted.attrs["missing"]:
        say(f"Muscles without own sEMG, which are free: {inverted.attrs['missing']}.")
    for text in doubts(inverted):
        warnings.warn(text, stacklevel=1)


def _invert_all(
    paths: list[Path], given: _Inversion, workers: int | None, scheduler: str | None
) -> None:
    """Invert several recordings by workers and print a table of them."""
    from emgface.inverse.many import invert_all

    with executing(workers, scheduler) as chosen, graceful_stop() as stopping:
        with progress("inverting") as bar:
            outcomes = invert_all(
                paths, given.face, given.plan, given.out, given.parameters,
                mapping=given.mapping, calibration=given.calibration, mixing=given.mixing,
                workers=chosen, observer=bar, stopping=stopping,
            )  # fmt: skip
    heads = ("recording", "rms distance [mm]", "of the motion", "width of intervals")
    done = [one for one in outcomes if one.status == "ok"]
    show_table(
        Rows(
            heads,
            tuple(
                (one.name, f"{1e3 * one.misfit:.2f}", f"{one.misfit_ratio:.0%}", _number(one.width))
                for one in done
            ),
        ),
        f"Inverted, {given.parameters.variant}",
    )
    for one in outcomes:
        if one not in done:
            say(f"Failed: {one.name}: {one.status.removeprefix('failed:')}: {one.reason}")
    say(f"Wrote {len(done)} of {len(outcomes)} activations to {given.out}.")
    if len(done) < len(outcomes):
        raise typer.Exit(PARTIAL if done else BAD_INPUT)


def _number(value: float) -> str:
    return "" if value != value else f"{value:.2f}"


@app.command()
def calibrate(
    recordings: Annotated[list[Path], typer.Argument(help="Calibration trials of one volunteer.")],
    out_path: Annotated[Path, typer.Option("--out", help="Calibration to write (netCDF).")],
    face: options.FacePath = None,
    study: options.StudyPath = None,
    mapping: options.MappingOption = None,
    mixing: MixingOption = None,
    cross_talk: Annotated[
        bool, typer.Option("--cross-talk", help="Estimate the mixing matrix as well.")
    ] = False,
    workers: options.WorkersOption = None,
    scheduler: options.SchedulerOption = None,
    force: Annotated[
        bool, typer.Option("--force", help="Compute an existing result again.")
    ] = False,
) -> None:
    """Estimate gain, delay and error of the sEMG of every muscle from trials with markers.

    The trials are fitted at the same time, and their fits are kept in the folder NAME_trials next to the
    result NAME.nc; `emgface study status` shows its state. A repeated command computes what is missing
    or whose inputs or code changed; an interrupted fit continues with its last complete iteration.
    """
    from emgface.api.given import face_of, study_of
    from emgface.inverse.calibrate_many import calibrate_all
    from emgface.inverse.mixing import read_mixing
    from emgface.inverse.parameters import without_contact
    from emgface.schema.netcdf import write_netcdf

    if out_path.exists() and not force:
        say(f"{out_path} exists and is kept: use --force to compute it again.")
        return
    plan = study_of(study)
    plan = plan.model_copy(update={"simulation": without_contact(plan.simulation)})
    declared = None if mixing is None else read_mixing(mixing)
    model = face_of(face, plan)
    announce_compilation()
    folder = out_path.with_name(f"{out_path.stem}_trials")
    with executing(workers, scheduler) as chosen, graceful_stop() as stopping:
        with progress("calibrating") as bar:
            calibrated = calibrate_all(
                recordings, model, plan, folder, mapping=mapping, mixing=declared,
                cross_talk=cross_talk, workers=chosen, observer=bar, stopping=stopping,
            )  # fmt: skip
    write_netcdf(calibrated.data, out_path, "emg_calibration")
    say(f"Wrote {out_path}: {calibrated.data.attrs['trials']} trials.")
    table = calibrated.data[["gain", "delay", "error", "estimated"]].to_dataframe()
    say(table[table["estimated"] == 1].drop(columns="estimated").round(3).to_string())
    if cross_talk:
        share = calibrated.data["mixing"].to_dataframe()["mixing"].unstack()
        share = share.where(share > 0.02).dropna(how="all", axis=0).dropna(how="all", axis=1)
        say("Share of muscles (columns) in signals (rows), above 0.02:")
        say(share.round(2).fillna("").to_string())
    say(
        f"Error of the face at markers that are left out: {calibrated.model_error:.0%} of their motion."
    )
