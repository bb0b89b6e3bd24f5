"""Function that estimates activations from measured motion."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray as xr

    from emgface.api.given import Data, File, Given


def invert(
    recording: "Data",
    face: "Data | None" = None,
    *,
    study: "Given" = None,
    mapping: "Mapping[str, Any] | File | None" = None,
    contact: bool = False,
    calibration: "Data | None" = None,
    progress: Callable[[int, int], None] | None = None,
    **parameters: Any,
) -> "xr.Dataset":
    """Estimate the activations of all muscles by which a face follows the lip markers.

    Parameters
    ----------
    recording : Dataset or path-like
        Recording of one trial with lip and face markers, and sEMG unless ``variant="motion"``.
    face : Dataset or path-like, optional
        Face model; default: that of the study.
    study : path-like, mapping or StudyConfiguration, optional
        Parameters of the sEMG and of the mechanics.
    mapping : mapping or path-like, optional
        Assigns names to a recording's labels, as in `read`.
    contact : bool
        Lips and teeth are in contact; only with ``form="step"``.
    calibration : Dataset or path-like, optional
        Result of ``emgface invert calibrate``: gain, delay and error of the sEMG of the volunteer.
    progress : callable, optional
        Called with the completed number of steps or iterations, and their total.
    **parameters : Any
        Parameters of `emgface.inverse.parameters.InverseParameters`, such as ``variant="motion"``
        (without sEMG), ``form="step"`` or ``left_out=("upper_lip_left",)``.

    Returns
    -------
    Dataset
        ``activation(muscle, time)`` [1] and, in the trajectory form, its intervals; ``misfit(time)``
        [m], the distance of the tracked markers per coordinate.

    Raises
    ------
    ConfigurationError
        A parameter is not valid.
    DataError
        The recording lacks markers or sEMG, or the face is not valid.
    SimulationError
        A step or an iteration does not converge.

    Examples
    --------
    >>> import emgface as ef
    >>> found = ef.invert("V1_A_1.c3d", "face.nc", variant="motion")  # doctest: +SKIP
    """
    from dataclasses import fields

    from emgface.api.given import dataset_of, face_of, recording_of, study_of
    from emgface.errors import ConfigurationError, listed
    from emgface.inverse.calibration import Calibration
    from emgface.inverse.parameters import InverseParameters, form_of, without_contact
    from emgface.inverse.run import invert as invert_recording
    from emgface.inverse.variants import trust_of

    known = [one.name for one in fields(InverseParameters)]
    if unknown := [name for name in parameters if name not in known]:
        raise ConfigurationError(
            f"there is no parameter {listed(unknown)} of an inversion, expected some of {listed(known)}"
        )
    chosen = InverseParameters(**parameters)
    trust_of(chosen.variant, (), chosen.emg_weight)
    form_of(chosen.form, contact)
    plan = study_of(study)
    simulation = plan.simulation if contact else without_contact(plan.simulation)
    fitted = None
    if calibration is not None:
        fitted = Calibration(dataset_of(calibration, "emg_calibration", "gain"))
    return invert_recording(
        recording_of(recording, mapping),
        face_of(face, plan),
        simulation,
        plan.signals,
        chosen,
        calibration=fitted,
        progress=progress,
    )
