"""Function that examines a recording or a model before it is used."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

    from emgface.api.given import Data, File


def check(
    given: "Data", *, study: bool = False, mapping: "Mapping[str, Any] | File | None" = None
) -> "dict[str, pd.DataFrame]":
    """Examine every channel and marker of a recording, or the counts and measures of a model.

    Parameters
    ----------
    given : Dataset or path-like
        Recording of any supported format, or a face, jaw, tongue or (as a file) head.
    study : bool
        Channels and markers of the study that the recording lacks are problems as well.
    mapping : mapping or path-like, optional
        Assigns names to a recording's labels, as in `read`.

    Returns
    -------
    dict of str to DataFrame
        Tables by their titles. Of a recording: ``channels and markers`` with rate [Hz], gaps [s],
        size and verdict; ``problems`` that prevent its use; ``warnings`` that a person should
        examine, such as exchanged sides; ``later steps`` that would refuse it, each with its reason.
        ``problems`` and ``later steps`` are empty if it can be used. Of a model: ``model``, its name
        and size, and tables of its counts and measures.

    Raises
    ------
    DataError
        The file is absent, damaged, or of an unknown format or content.
    ConfigurationError
        The mapping is not valid.

    Examples
    --------
    >>> import emgface as ef
    >>> ef.check("V1_A_1.c3d")["problems"]  # doctest: +SKIP
    """
    import pandas as pd
    import xarray as xr

    from emgface.anatomy.checked import checked_model
    from emgface.api.given import kind_of_given, recording_of
    from emgface.api.readiness import refusals
    from emgface.models.kinds import MODEL_KINDS
    from emgface.recordings.check import check_recording, problems
    from emgface.signals.parameters import SignalChain

    stated = kind_of_given(given, "a recording or a model")
    for kind in MODEL_KINDS.values():
        if kind.model == stated:
            model = (
                checked_model(given, stated)
                if isinstance(given, xr.Dataset)
                else kind.functions.read(Path(given))
            )
            description = pd.DataFrame({"description": [kind.functions.describe(model)]})
            return {"model": description, **dict(kind.functions.check(model))}
    recording = recording_of(given, mapping)
    report = check_recording(recording, study=study)
    refused = refusals(recording, SignalChain())
    return {
        "channels and markers": report,
        "problems": pd.DataFrame({"problem": problems(report)}, dtype=object),
        "warnings": pd.DataFrame({"warning": problems(report, "warning")}, dtype=object),
        "later steps": pd.DataFrame(refused.items(), columns=["step", "reason"]),
    }
