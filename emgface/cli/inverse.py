"""``emgface inverse``: activations of all muscles from lip markers, with and without sEMG."""

import warnings
from pathlib import Path
from typing import Annotated

import typer

from emgface.cli.console import progress, say
from emgface.cli.machine import announce_compilation
from emgface.cli.options import FacePath, MappingOption, StudyPath

app = typer.Typer(no_args_is_help=True, help="Estimate activations from measured motion.")


@app.command()
def run(
    recording: Annotated[Path, typer.Argument(help="Recording of one trial.")],
    out_path: Annotated[Path, typer.Option("--out", help="Activation to write (netCDF).")],
    face: FacePath = None,
    study: StudyPath = None,
    mapping: MappingOption = None,
    variant: Annotated[str, typer.Option(help="assisted, hybrid, motion or driven.")] = "assisted",
    emg_weight: Annotated[
        float, typer.Option(help="Weight of the sEMG in the assisted variant.")
    ] = 1.0,
    gain: Annotated[float, typer.Option(help="Factor on the normalised sEMG.")] = 1.0,
    delay: Annotated[
        float, typer.Option(help="Time by which the sEMG precedes the force [s].")
    ] = 0.04,
    leave_out: Annotated[
        list[str] | None, typer.Option(help="Lip marker that is not tracked; repeatable.")
    ] = None,
    contact: Annotated[
        bool, typer.Option(help="Contact of lips and teeth as in the study, or none.")
    ] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Compute an existing result again.")
    ] = False,
) -> None:
    """Estimate the activations of all muscles by which the face follows the lip markers."""
    from emgface.api.given import face_of, recording_of, study_of
    from emgface.inverse.run import FOLLOWED, InverseParameters, invert
    from emgface.inverse.variants import trust_of
    from emgface.schema.netcdf import write_netcdf

    trust_of(variant, (), emg_weight)  # errors before the face is built
    if out_path.exists() and not force:
        say(f"{out_path} exists and is kept: use --force to compute it again.")
        return
    plan = study_of(study)
    simulation = plan.simulation
    if not contact:
        none = simulation.contact.model_copy(update={"method": "none"})
        simulation = simulation.model_copy(update={"contact": none})
    parameters = InverseParameters(
        variant=variant,  # pyright: ignore[reportArgumentType]  # checked above
        emg_weight=emg_weight,
        gain=gain,
        delay=delay,
        left_out=tuple(leave_out or ()),
    )
    data, model = recording_of(recording, mapping), face_of(face, plan)
    announce_compilation()
    with progress("inverting") as bar:
        found = invert(data, model, simulation, plan.signals, parameters, progress=bar.show)
    write_netcdf(found, out_path, "activation")
    rms = 1e3 * float((found["misfit"] ** 2).mean()) ** 0.5
    say(
        f"Wrote {out_path}: {variant}, {found.sizes['time']} steps in "
        f"{found.attrs['run_time_s']:.1f} s, rms distance of the tracked markers {rms:.2f} mm per "
        f"coordinate ({found.attrs['misfit_ratio']:.0%} of their motion), "
        f"at most {int(found['saturated'].max())} muscles at their bound."
    )
    if not found.attrs["misfit_ratio"] <= FOLLOWED:
        warnings.warn(
            f"the face does not follow the markers: the misfit exceeds {FOLLOWED:.0%} of their motion. "
            "Check names, axes and unit of the markers (`emgface data check`) before using the result.",
            stacklevel=1,
        )
