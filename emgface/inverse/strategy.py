"""Activations and motions of the strategies of a study that follow the markers."""

from typing import Final

import xarray as xr

from emgface.face.simulation_parameters import SimulationParameters
from emgface.inverse.configuration import VARIANT, InverseConfiguration
from emgface.inverse.parameters import InverseParameters
from emgface.inverse.run import invert
from emgface.muscles import LIP_MARKERS
from emgface.signals.parameters import SignalChain

FOLDS: Final = tuple(
    tuple(name for name in LIP_MARKERS if name.rsplit("_", 1)[0] == pair)
    for pair in dict.fromkeys(name.rsplit("_", 1)[0] for name in LIP_MARKERS)
)
"""Pairs of markers, left and right, that are left out together: neighbours determine each other."""


def inverse_activation(
    recording: xr.Dataset,
    face: xr.Dataset,
    simulation: SimulationParameters,
    chain: SignalChain,
    strategy: str,
    chosen: InverseConfiguration,
    left_out: tuple[str, ...],
    *,
    settled: xr.Dataset,
    session: xr.Dataset | None,
) -> xr.Dataset:
    """Activation of one recording with a strategy, without the markers in `left_out`.

    `simulation` is without contact, and `session` the range over which the sEMG is normalised, if not
    that of the trial. Errors as `emgface.inverse.run.invert`.
    """
    parameters = InverseParameters(
        variant=VARIANT[strategy],
        form=chosen.form,
        emg_weight=chosen.emg_weight,
        gain=chosen.gain,
        delay=chosen.delay,
        left_out=left_out,
    )
    inverted = invert(
        recording, face, simulation, chain, parameters, settled=settled, session=session
    )
    selected = {"selected": " ".join(dict.fromkeys(str(m)[:-2] for m in inverted["muscle"].values))}
    return inverted.assign_attrs(selected, strategy=strategy, warnings="")


def crossed(motions: dict[tuple[str, ...], xr.Dataset]) -> xr.Dataset:
    """Motion whose markers are those of the motions for which they were left out.

    `motions` are simulations with the activations estimated without a group of markers, by that
    group. Other variables are those of the first.
    """
    first = next(iter(motions.values()))
    parts = [one["position"].sel(marker=list(out)) for out, one in motions.items()]
    position = xr.concat(parts, dim="marker").sel(marker=first["marker"].values)
    position = position.transpose(*first["position"].dims).assign_attrs(first["position"].attrs)
    attrs = {"run_time_s": sum(float(one.attrs["run_time_s"]) for one in motions.values())}
    return first.assign(position=position).assign_attrs(attrs, left_out="each pair of markers")
