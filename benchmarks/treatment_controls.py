"""Controls of the explanations of trends of a treatment: gape, pursing in contact, residual gap.

    python -m benchmarks treatment_controls
    python -m benchmarks treatment_controls --only gape

Each cause is present in one face and absent from another, and the number that it explains is printed
for both. Simulated data; a research model, not validated on patients.
"""

from collections.abc import Iterator
from typing import Annotated, Any, Final

import typer
import xarray as xr

import emgface as ef
from benchmarks.treatment import parameters, wedge
from emgface.face.motion import settle_face, simulate_face
from emgface.face.template import template_face
from emgface.treatment.motions import gestures
from emgface.treatment.outcomes import OUTCOMES, UNIT_FACTORS

FREE: Final[dict[str, Any]] = {"contact": {"method": "none"}}
CUT: Final = {"kind": "incision", "place": 0.5, "height": 12.0}


def moved(face: xr.Dataset, name: str, **given: Any) -> xr.Dataset:
    """Motion of a face under a gesture, at 100 kPa."""
    simulation = parameters(sigma_max=100e3, **given)
    settled = settle_face(face, simulation)
    return simulate_face(face, gestures(face)[name], simulation, settled=settled)


def gape() -> Iterator[tuple[str, str]]:
    """Gape of a medium face without contact, by the loss of tissue and by the scar alone."""
    face = template_face(resolution="medium")
    removed = {"width": 8.0, "height": 12.0}
    for what, plan in (
        ("untreated", None),
        ("cut, no loss, no scar", {"step": [CUT | {"scar": False}]}),
        ("cut, no loss, scar of 3", {"step": [CUT]}),
        ("V of 8 mm, no scar", wedge(**removed, scar=False)),
        ("V of 8 mm, scar of 3", wedge(**removed)),
        ("V of 8 mm, scar of 10", wedge(**removed, scar={"stiffness": 10.0})),
    ):
        treated = face if plan is None else ef.treat(face, plan)
        opened = 1e3 * moved(treated, "opening", **FREE)["lip_opening"].values
        yield what, f"{opened.max():.2f} mm, {opened.max() - opened[0]:.2f} mm from rest"


def pursing() -> Iterator[tuple[str, str]]:
    """Pursing of a medium face without contact, with that of the lips, and with teeth as well."""
    face = template_face(resolution="medium")
    shown = [o for o in OUTCOMES if o.name in ("pursing, amplitude", "pursing, protrusion")]
    for what, contact in (
        ("without contact", {"method": "none"}),
        ("contact of the lips", {"between": ("lips",)}),
        ("contact of lips and teeth", {}),
    ):
        for width in (12.0, 16.0):
            treated = ef.treat(face, wedge(width=width, height=12.0))
            motion = moved(treated, "A", contact=contact)
            values = [UNIT_FACTORS[o.unit] * o.value(treated, motion) for o in shown]
            yield f"{what}, V of {width:g} mm", ", ".join(f"{v:.2f}" for v in values) + " mm"


def gap() -> Iterator[tuple[str, str]]:
    """Area between the lips of a coarse face at rest and pressed together, cut without loss."""
    face = template_face(resolution="coarse")
    for what, own in (("untreated", None), ("cut, joined", "all"), ("cut, not joined", "none")):
        step = CUT | {"height": 11.0, "rejoin": own}
        treated = face if own is None else ef.treat(face, {"step": [step]})
        area = 1e6 * moved(treated, "closing")["mouth_area"].values
        yield what, f"{area[0]:.2f}, {area.min():.2f} mm²"


CONTROLS: Final = {"gape": gape, "pursing": pursing, "gap": gap}


def main(
    only: Annotated[list[str] | None, typer.Option(help="Control to run; repeatable.")] = None,
) -> None:
    for name in only or CONTROLS:
        print(f"{name}: {(CONTROLS[name].__doc__ or '').splitlines()[0]}", flush=True)
        for what, value in CONTROLS[name]():
            print(f"  {what:36s} {value}", flush=True)
