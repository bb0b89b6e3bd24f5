"""Gain, delay and error of the sEMG of every muscle of one person, as a file."""

from collections.abc import Sequence
from dataclasses import dataclass

import xarray as xr

from emgface.errors import ConfigurationError
from emgface.inverse.signals import without_absent
from emgface.signals.parameters import SignalChain
from sim.state import Array

SAME_STRESS = 1e-6
"""Relative difference of sigma_max that counts as none."""


@dataclass(frozen=True)
class Calibration:
    """Result of `emgface.inverse.calibrate.calibrate`, a dataset of the kind "emg_calibration".

    Gains are relative to the strength of the face: gain and sigma_max are not separable.
    """

    data: xr.Dataset

    def for_muscles(self, muscles: Sequence[str]) -> tuple[Array, Array, Array]:
        """Gain [1], delay [s] and standard deviation of the error [1] of muscles, each (n,)."""
        one = self.data.sel(muscle=list(muscles))
        return one["gain"].values, one["delay"].values, one["error"].values

    def mixing(self, muscles: Sequence[str]) -> Array | None:
        """Share (n, n) of every muscle in every signal; None without cross-talk."""
        if "mixing" not in self.data:
            return None
        return self.data["mixing"].sel(signal=list(muscles), muscle=list(muscles)).values

    @property
    def model_error(self) -> float:
        """Error of the face at markers that were left out, over their displacement [1]."""
        return float(self.data.attrs["model_error"])

    def applied(
        self, chain: SignalChain, sigma_max: float, recording: xr.Dataset
    ) -> tuple[SignalChain, xr.Dataset]:
        """Chain that normalises over the range of the calibration trials, and this range.

        Raises ConfigurationError if volunteer or sigma_max [Pa] are not those of the calibration.
        """
        attrs = self.data.attrs
        volunteer = str(recording.attrs.get("volunteer", ""))
        if volunteer != attrs["volunteer"]:
            raise ConfigurationError(
                f"the calibration is of volunteer '{attrs['volunteer']}', the recording of "
                f"'{volunteer}': calibrate with trials of the same volunteer"
            )
        if abs(sigma_max - attrs["sigma_max"]) > SAME_STRESS * sigma_max:
            raise ConfigurationError(
                f"the calibration is for sigma_max = {attrs['sigma_max']:g} Pa, the study has "
                f"{sigma_max:g} Pa, and gains are relative to it: calibrate again"
            )
        names = {"minimum": self.data["minimum"], "maximum": self.data["maximum"]}
        about = {"volunteer": volunteer, "parameters": attrs["range_parameters"]}
        return over_session(chain), xr.Dataset(names, attrs=about)


def over_session(chain: SignalChain) -> SignalChain:
    """Chain whose normalisation is over a session; trials beyond its range are clipped.

    Muscles of channels that were not recorded are left out.
    """
    chain = without_absent(chain)
    changed = {"reach": "session", "outside": "clip", "silent": "zero"}
    return chain.model_copy(
        update={"normalisation": chain.normalisation.model_copy(update=changed)}
    )
