"""Output of the commands that move a jaw, tongue or head: pages and figures, and what was written."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emgface.cli.console import say

if TYPE_CHECKING:
    import xarray as xr

ExcitationOption = Annotated[
    Path | None,
    typer.Option(help="Excitations (csv, nc) with a column time and one per exciter."),
]
PictureOption = Annotated[
    Path | None,
    typer.Option(
        "--out",
        help="Page (html) or figure (png, svg, pdf); default: a page.",
    ),
]


def check_drive(muscle: list[str] | None, excitation: Path | None) -> None:
    """Raise ConfigurationError if muscles and a series of excitations are both specified."""
    from emgface.errors import ConfigurationError

    if muscle and excitation is not None:
        raise ConfigurationError(
            "--muscle and --excitation are both specified, expected one of them: add the muscles to the "
            "series, or leave out the file"
        )


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
    """Report the file written, clipped excitations and a loss of stability."""
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
