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
    kind: Annotated[
        str,
        typer.Option(
            help="face, or jaw: excitations from temporalis, masseter and digastric (MAS_L ...)."
        ),
    ] = "face",
) -> None:
    """Compute muscle activations from the sEMG of a recording."""
    if kind == "jaw":
        _activate_jaw(recording, out_path, reference, mapping, band, feature, clip)
        return
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


def _activate_jaw(
    recording: Path,
    out_path: Path,
    reference: list[Path] | None,
    mapping: Path | None,
    band: tuple[float, float] | None,
    feature: str | None,
    clip: bool,
) -> None:
    """Compute excitations of a jaw from the sEMG of temporalis, masseter and digastric."""
    from emgface.anatomy.jaw.emg import excitation_of
    from emgface.choices import configure
    from emgface.cli.options import chain_with
    from emgface.recordings.dataset import read_recording
    from emgface.schema.netcdf import write_netcdf
    from emgface.signals.parameters import SignalChain

    chain = chain_with(SignalChain(), band=band, feature=feature)
    if clip:
        values = chain.model_dump()
        values["normalisation"]["outside"] = "clip"
        chain = configure(SignalChain, values, where="options")
    given = (read_recording(one, mapping=mapping) for one in reference or ())
    excitation = excitation_of(read_recording(recording, mapping=mapping), chain, reference=given)
    write_netcdf(excitation, out_path, "jaw_excitation")
    if passive := excitation.attrs["passive"]:
        say(f"No channel drives {passive}; these muscles are passive.")
    if not reference:
        say("Without --reference the highest value of every channel is taken as full activity.")
    if (above := excitation.attrs["exceeded_fraction"]) > 0.0:
        say(f"{100.0 * above:.2g} % of the samples exceed maximum effort and are clipped to it.")
    if (below := excitation.attrs["clipped_fraction"] - above) > 1e-9:
        say(
            f"{100.0 * below:.2g} % lie below the resting level of the reference and are set to zero."
        )
    say(f"Wrote {out_path}: {excitation.sizes['exciter']} exciters.")


def score(
    recording: Annotated[Path, typer.Argument(help="Recording of the trial.")],
    motion: Annotated[Path, typer.Argument(help="Motion written by 'simulate'.")],
    out_path: Annotated[Path, typer.Option("--out", help="Scores to write (netCDF).")],
    face: options.ModelPath = None,
    study: options.StudyPath = None,
    mapping: options.MappingOption = None,
    baseline: options.BaselineOption = None,
) -> None:
    """Align measured with simulated motion of lips or jaw, and score every marker."""
    from emgface.models.kinds import MODEL_KINDS, kind_of_motion
    from emgface.schema.netcdf import kind_of, write_netcdf

    named = kind_of(motion) if motion.is_file() else ""
    kind = MODEL_KINDS["face"] if named in ("", "trajectory") else kind_of_motion(motion)
    if kind.name != "face":
        from emgface.cli.tables import rows_of
        from emgface.recordings.dataset import read_recording

        given = {"baseline": baseline, "model": face, "study": study}
        measured = read_recording(recording, mapping=mapping)
        scores, table, note = kind.functions.scored(measured, motion, given)
        write_netcdf(scores, out_path, "scores")
        show_table(*rows_of(table, f"{recording.name}, {motion.name}"))
        for text in (note, f"Wrote {out_path}."):
            if text:
                say(text)
        return
    import emgface as ef
    from analysis.flags import FLAGS, flags_of
    from emgface.cli.tables import score_rows

    scores = ef.score(recording, motion, face=face, study=study, mapping=mapping)
    write_netcdf(scores, out_path, "scores")
    title = f"{recording.name} ({scores.attrs['origin']}), shift {float(scores['shift']):.3f} s"
    show_table(score_rows(scores), title)
    for name in flags_of(scores):
        say(f"Flag {name}: {FLAGS[name]}.")
    say(f"Wrote {out_path}.")
