"""Tongues as a kind of model (`emgface.models.kinds.Functions`)."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from emgface.errors import FitError, TongueError, listed
from emgface.models.kinds import (
    Drive,
    Evidence,
    FittedModel,
    Moved,
    Person,
    Progress,
    chosen,
    error_of,
    levels_of,
    names_file,
    refuse_unused,
    tolerance_of,
)
from emgface.schema.netcdf import write_netcdf


def build(person: Person) -> xr.Dataset:
    """Generate the tongue of the person of a generated face and jaw."""
    from emgface.anatomy.jaw.template.measures import parse_settings
    from emgface.anatomy.tongue.template import template_tongue

    return template_tongue(
        resolution=person.resolution or "medium",
        measures=parse_settings(list(person.measures)),
        preset=person.preset,
        seed=person.seed,
    )


def import_(folder: Path, settings: Mapping[str, str]) -> xr.Dataset:
    """Import the published hexahedral tongue."""
    from emgface.anatomy.tongue.published import import_tongue

    return import_tongue(folder, **chosen(import_tongue, settings, "forces", "rest"))


def read(path: Path) -> xr.Dataset:
    """Read a tongue."""
    from emgface.anatomy.checked import read_model

    return read_model(path, "tongue_model")


def write(tongue: xr.Dataset, path: Path) -> object:
    """Write a tongue."""
    return write_netcdf(tongue, path, "tongue_model")


def fit(
    tongue: xr.Dataset, evidence: Evidence, progress: Callable[[str, int, int], None]
) -> FittedModel:
    """Fit a tongue to the fitted jaw of a person and, if there is one, the surface ``tongue``.

    Without `Evidence.before`, the jaw was fitted from the generated one.
    """
    from emgface.anatomy.checked import read_model
    from emgface.anatomy.jaw.template import template_jaw
    from emgface.fit.parts_report import fitted_tongue_page, tongue_summary, write_fit_page
    from emgface.fit.tongue import fit_tongue

    if evidence.frame is None:
        raise FitError(
            "no frame is given, expected the fitted jaw of the same person: the bones carry the "
            "tongue, so fit the jaw first"
        )
    if unknown := [name for name in evidence.surfaces if name != "tongue"]:
        raise FitError(f"a tongue has no surface {listed(unknown)}, expected 'tongue' or none")
    after = read_model(evidence.frame, "jaw_model")
    before = template_jaw() if evidence.before is None else read_model(evidence.before, "jaw_model")
    fitted = fit_tongue(
        tongue, before, after, surface=evidence.surfaces.get("tongue"), unit=evidence.unit,
        name=evidence.name, progress=progress,
    )  # fmt: skip
    return FittedModel(
        fitted.tongue,
        (*fitted.notes, *tongue_summary(fitted)),
        partial(write_fit_page, fitted_tongue_page(fitted)),
    )


def describe(tongue: xr.Dataset) -> str:
    """Describe a tongue."""
    return (
        f"{tongue.attrs['name']}: {tongue.sizes['element']} elements, "
        f"{tongue.sizes['muscle']} muscles, {tongue.sizes['attachment']} attached nodes"
    )


def _variant(variant: str = "elements", gravity: bool = True) -> Any:
    """Parameters of a variant."""
    from emgface.anatomy.tongue.parameters import variant as variant_of

    return variant_of(variant, gravity=gravity)


def check(model: Any) -> list[tuple[str, pd.DataFrame]]:
    """Return no table: reading has checked the model."""
    return []


def move(tongue: xr.Dataset, drive: Drive, progress: Progress) -> Moved:
    """Move a tongue by excitations; jaw and hyoid do not move.

    Exciters with levels rise and fall. Settings are ``variant`` and ``gravity``.
    """
    from emgface.anatomy.jaw.series import duration_of, read_excitation
    from emgface.anatomy.tongue.actions import ACTION_DURATION, ACTION_LEVEL, raised_muscles
    from emgface.anatomy.tongue.published import read_gesture
    from emgface.anatomy.tongue.run import TONGUE_OUTPUT, simulate_tongue

    tolerance = tolerance_of(drive.accuracy)
    refuse_unused(drive, (), "what moves a tongue")
    path, duration = Path(drive.source), drive.duration
    if names_file(drive.source):
        read_drive = read_gesture if path.suffix == ".txt" else read_excitation
        excitation, name = read_drive(path), path.stem
        duration = duration_of(excitation, TONGUE_OUTPUT, duration)
    else:
        levels = levels_of(drive.source, ACTION_LEVEL)
        if len({*levels.values()}) > 1:
            raise TongueError(
                f"{drive.source!r} has several levels, expected one that all exciters reach: "
                "specify a file of excitations"
            )
        duration = ACTION_DURATION if duration is None else duration
        level = next(iter(levels.values()), ACTION_LEVEL)
        excitation, name = (
            raised_muscles(*levels, level=level, duration=duration),
            " and ".join(levels),
        )
    parameters = _variant(**chosen(_variant, drive.settings, "variant", "gravity"))
    step: dict[str, Any] = {} if drive.step is None else {"step": drive.step}
    motion = simulate_tongue(
        tongue, excitation, duration=duration, parameters=parameters, tolerance=tolerance,
        progress=progress, **step,
    )  # fmt: skip
    motion.attrs["task"] = name or "rest"
    return Moved(motion, [error_of(motion, tolerance)])


def write_motion(motion: xr.Dataset, tongue: xr.Dataset, path: Path) -> object:
    """Write the motion of a tongue."""
    return write_netcdf(motion, path, "tongue_motion")


def table(
    tongue: xr.Dataset, settings: Mapping[str, str], progress: Progress
) -> tuple[str, pd.DataFrame]:
    """Raise and release every muscle, and tabulate how tip, back, size and volume change."""
    from emgface.anatomy.tongue.actions import action_table

    own = {k: v for k, v in settings.items() if k in ("level", "step")}
    rest = {k: v for k, v in settings.items() if k not in own}
    parameters = _variant(**chosen(_variant, rest, "variant", "gravity"))
    options = chosen(action_table, own, "level", "step")
    actions = action_table(tongue, parameters, progress=progress, **options)
    return f"{tongue.attrs['name']}, simulated, mm", actions


def scored(
    recording: xr.Dataset, motion: Path, options: Mapping[str, Any]
) -> tuple[xr.Dataset, pd.DataFrame, str]:
    """Raise TongueError: no recording of this package contains points of a tongue."""
    raise TongueError(
        "recordings have no points of a tongue, expected the motion of a face, jaw or head: choose one"
    )
