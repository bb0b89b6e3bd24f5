"""Later steps that cannot use a recording, each with its reason."""

import warnings
from collections.abc import Callable

import xarray as xr

from emgface.errors import EmgfaceError, FeatureWarning, SchemaError
from emgface.recordings.bids.write import bids_entities
from emgface.recordings.head import in_head_frame
from emgface.signals.activation import activation_of
from emgface.signals.filters import check_gaps
from emgface.signals.parameters import SignalChain
from emgface.study.table import place_of


def refusals(recording: xr.Dataset, chain: SignalChain) -> dict[str, str]:
    """Return the steps that would refuse a recording under its final labels, with the reason.

    The keys are some of ``activate``, ``score``, ``study run`` and ``convert --to bids``.
    Conditions that depend on other data than the recording are not examined.
    """
    steps: dict[str, Callable[[], object]] = {
        "activate": lambda: activation_of(recording, chain),
        "score": lambda: _scored(recording, chain),
        "study run": lambda: place_of(recording, "it"),
        "convert --to bids": lambda: _converted(recording),
    }
    reasons: dict[str, str] = {}
    for step, attempt in steps.items():
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", FeatureWarning)
                attempt()
        except EmgfaceError as error:
            reasons[step] = " ".join(str(error).split())
    inherited = [step for step in ("activate", "score") if step in reasons]
    if inherited:  # a study applies both to every trial
        own = [reasons["study run"]] if "study run" in reasons else []
        reasons["study run"] = "; ".join([*own, f"see {' and '.join(inherited)}"])
    return reasons


def _scored(recording: xr.Dataset, chain: SignalChain) -> None:
    if "position" not in recording:
        raise SchemaError(
            "it contains no marker positions, expected those of six face and ten lip "
            "markers: the motion can be simulated but not compared"
        )
    in_head_frame(recording["position"], chain.head_frame)


def _converted(recording: xr.Dataset) -> None:
    bids_entities(recording)
    if "emg" in recording:
        check_gaps(recording["emg"])
