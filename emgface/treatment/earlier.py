"""Words on the treatments that a face already carries: the same plan, and sutures in an excision."""

from typing import Any, Final

import numpy as np
import xarray as xr

from emgface.errors import FaceError
from emgface.face.identity import told_treatment, treatments
from emgface.treatment.outline import in_excision, outline_of
from emgface.treatment.plan import Incision, Plan, Step, Wedge, steps_digest

SUTURED: Final = "removed_volume_mm3"  #: in the report of a step that has a suture


def plan_again(model: xr.Dataset, plan: Plan) -> str:
    """Sentence on a treatment of a face or jaw that has the same steps as a plan; empty if none."""
    own = steps_digest([plan])
    same = [e for e in treatments(model) if steps_digest([e["plan"]]) == own]
    if not same:
        return ""
    return (
        f"{str(model.attrs['name'])!r} already carries {told_treatment(same[-1])}, which has the same "
        f"steps ({own}): they would act twice, expected another plan; treat the model before it, or, if "
        "this is meant, write the steps of both in one plan"
    )


def earlier_cuts(face: xr.Dataset, step: Step, entries: list[dict[str, Any]]) -> str:
    """Words on the earlier cuts whose sutures lie in an excision, and on what to do; or none."""
    if "suture_cut" not in face or not isinstance(step, Wedge | Incision):
        return ""
    try:
        outline = outline_of(face, step)
    except FaceError:
        return ""
    at = face["position"].values[face["suture_node"].values]
    hit = np.unique(face["suture_cut"].values[in_excision(face, outline, step.lip, at)])
    if not len(hit):
        return ""
    cuts = [
        (entry, f"step {report['step']} ({report['kind']})")
        for entry in entries
        for report in entry["steps"]
        if SUTURED in report
    ]
    if hit.max() >= len(cuts):
        return (
            "; the excision contains the suture of an earlier one: excise both at once by one wedge"
        )
    named = [
        f"{words} of {'this plan' if entry is entries[-1] else told_treatment(entry)}"
        for entry, words in (cuts[k] for k in hit)
    ]
    return (
        f"; the excision contains the suture of {' and of '.join(named)}: excise both at once by one "
        "wedge, in the model before it"
    )
