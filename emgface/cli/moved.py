"""Output of the commands that move a jaw, tongue or head: pages and figures, and what was written."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emgface.cli.console import say

if TYPE_CHECKING:
    import xarray as xr

PictureOption = Annotated[
    Path | None,
    typer.Option("--out", help="Page (html) or figure (png, svg, pdf); default: a page beside it."),
]


def write_picture(
    motion: Path, out: Path | None, page: Callable[[], str], figure: Callable[[], Any]
) -> None:
    """Write the page of a motion, or its figure if the suffix of `out` is that of a picture."""
    from analysis.figures.style import save
    from emgface.files import write_text
    from emgface.pictures.show import PAGES

    out = out or motion.with_suffix(".html")
    if out.suffix.lower() in PAGES:
        write_text(out, page())
    else:
        save(figure(), out)
    say(f"Wrote {out}.")


def tell_motion(motion: "xr.Dataset", out: Path, name: str) -> None:
    """Tell what was simulated and written, which excitations were clipped, and lost stability."""
    clipped = motion.attrs["clipped_excitation"]
    if clipped < 0.0:
        say(f"Negative excitations, down to {clipped:.3g}, were set to zero.")
    if "unstable_from_s" in motion.attrs:
        say(
            f"The equilibrium lost stability between {motion.attrs['unstable_from_s']:.4g} and "
            f"{motion.attrs['unstable_until_s']:.4g} s: there the motion may depend on the step and on "
            "rounding; compare it with one of smaller steps."
        )
    say(f"Wrote {out}: {motion.attrs['task']} of the {name}, simulated.")
