"""Difference of outcomes between both methods of cutting, the part of their error that a mesh causes."""

from typing import Any, Final

import pandas as pd
import xarray as xr

from emgface.errors import FaceError
from emgface.face.identity import treatments_between
from emgface.face.simulation_parameters import SimulationParameters
from emgface.treatment.plan import CUTS, Plan, applied_plan
from emgface.treatment.treat import treat_face

OTHER_CUT: Final = {"conforming": "elements", "elements": "conforming"}


def with_other_cut(plan: Plan) -> Plan:
    """Plan whose cuts use the other method each; FaceError if it has no cut."""
    if not any(isinstance(step, CUTS) for step in plan.step):
        raise FaceError(
            f"the plan {plan.name!r} cuts nothing, expected a wedge, tumour or incision: methods of "
            "cutting differ only there"
        )
    steps: list[Any] = [
        step.model_copy(update={"method": OTHER_CUT[step.method]})
        if isinstance(step, CUTS)
        else step
        for step in plan.step
    ]
    return plan.model_copy(update={"step": tuple(steps)})


def other_cut(
    intact: xr.Dataset, treated: xr.Dataset, parameters: SimulationParameters | None = None
) -> xr.Dataset:
    """Treat a face again by the plans of a treated one, with the other method of every cut.

    Raises DataError if `treated` is not a treatment of `intact`, and FaceError if it cuts nothing or the
    other method cannot close the wound.
    """
    face = intact
    for entry in treatments_between(intact, treated):
        plan = with_other_cut(applied_plan(entry))
        face = treat_face(face, plan, parameters)
    return face


def with_cut_difference(outcomes: pd.DataFrame, other: pd.DataFrame) -> pd.DataFrame:
    """Outcomes with the change by the other method, and the interval that contains both changes.

    An end is unknown (NaN) where a change is a bound that is open in its direction.
    """
    theirs = other[["outcome", "change", "bound"]]
    theirs = theirs.set_axis(["outcome", "change, other cut", "bound of the other"], axis=1)
    merged = outcomes.merge(theirs, "left", "outcome")
    both = merged[["change", "change, other cut"]]
    bounds = merged[["bound", "bound of the other"]]
    open_below, open_above = (bounds.isin([one, "both"]).any(axis=1) for one in ("before", "after"))
    merged["change, lowest of both cuts"] = both.min(axis=1, skipna=False).mask(open_below)
    merged["change, highest of both cuts"] = both.max(axis=1, skipna=False).mask(open_above)
    return merged.drop(columns="bound of the other")
