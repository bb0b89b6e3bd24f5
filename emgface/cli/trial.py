"""``emgface activate`` and ``score``: stages of one trial, one by one."""

from pathlib import Path
from typing import Annotated

import typer

from emgface.cli import options
from emgface.cli.console import say, show_table


def activate(
    recording: Annotated[Path, typer.Argument(help="Recording of one trial.")],
    out_path: Annotated[Path, typer.Option("--out", help="Activation to write (netCDF).")],
    strategy: Annotated[
        str | None, typer.Option(help="Strategy: act_all, act_3, act_rel, act_threshold, or true.")
    ] = None,
    instruction: options.InstructionOption = None,
    mapping: options.MappingOption = None,
    study: options.StudyPath = None,
    band: options.BandOption = None,
    feature: options.FeatureOption = None,
    missing_side: options.MissingSideOption = None,
    missing_muscle: options.MissingMuscleOption = None,
    reference: options.ReferenceOption = None,
    clip: options.ClipOption = False,
    plot: Annotated[Path | None, typer.Option(help="Picture of the activations to write.")] = None,
) -> None:
    """Compute muscle activations from the sEMG of a recording."""
    import emgface as ef
    from emgface.cli.tables import activation_rows
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
        reference=reference or None,
        normalisation={"outside": "clip"} if clip else {},
    )
    write_netcdf(activation, out_path, "activation")
    show_table(activation_rows(activation), f"{recording.name}, {activation.attrs['origin']}")
    if montage := activation.attrs.get("montage"):
        say(f"Montage: {montage}.")
    if plot is not None:
        from emgface.pictures.show import draw

        say(f"Wrote {draw(activation, plot)}.")
    say(f"Wrote {out_path}.")


def score(
    recording: Annotated[Path, typer.Argument(help="Recording of the trial.")],
    trajectory: Annotated[Path, typer.Argument(help="Trajectory written by 'simulate'.")],
    out_path: Annotated[Path, typer.Option("--out", help="Scores to write (netCDF).")],
    face: options.FacePath = None,
    study: options.StudyPath = None,
    mapping: options.MappingOption = None,
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
