"""The option ``--band`` of commands that filter a recording."""

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from emgface.signals.parameters import SignalChain

BandOption = Annotated[
    tuple[float, float] | None,
    typer.Option(
        metavar="LOW HIGH",
        help="Pass-band [Hz] instead of that of the signal chain, for example 20 400.",
    ),
]


def with_band(chain: "SignalChain", band: tuple[float, float] | None) -> "SignalChain":
    """Return the signal chain with another pass-band [Hz], where one is given."""
    if band is None:
        return chain
    from emgface.choices import configure
    from emgface.signals.parameters import FilterParameters

    wanted = chain.filter.model_dump() | {"low": band[0], "high": band[1]}
    return chain.model_copy(update={"filter": configure(FilterParameters, wanted, where="--band")})
