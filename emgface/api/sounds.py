"""Function that computes formants and voice of a vocal tract."""

import warnings
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr

    from emgface.api.given import Data, File


def sound(
    motion: "Data | None" = None,
    *,
    vowel: str = "u",
    source: str | None = "folds",
    duration: float | None = None,
    rate: int = 44_100,
    lung: float = 785.0,
    tension: float = 1.0,
    pitch: float = 120.0,
    seed: int = 0,
    wave: "File | None" = None,
) -> "xr.Dataset":
    """Compute the formants and the voice of a vowel, or of the lips of a simulated motion.

    Parameters
    ----------
    motion : Dataset or path-like, optional
        Trajectory of `simulate` whose lips end the tract; the rest of the tract does not move.
    vowel : str
        Idealised tract: "a", "i" or "u", no person's measures.
    source : str, optional
        "folds" (two masses), "rosenberg", or a wave file with the flow of the glottis; None for
        formants alone.
    duration : float, optional
        Length of the sound [s]; default: that of the motion.
    rate : int
        Samples per second [Hz].
    lung : float
        Lung pressure of the folds [Pa].
    tension : float
        Tension of the folds, about 0.5 to 2 [1].
    pitch : float
        Pitch of the source "rosenberg" [Hz].
    seed : int
        Seed of the turbulence noise.
    wave : path-like, optional
        Wave file to write.

    Returns
    -------
    Dataset
        ``formant_frequency`` and ``formant_bandwidth`` [Hz] over time and formant, ``area`` [m^2],
        and with a source ``sound`` [Pa].

    Raises
    ------
    DataError
        The vowel or source is unknown, or the motion lacks the area of the mouth.

    Warns
    -----
    FeatureWarning
        The tract is closed at some instants, or nothing is heard.

    Examples
    --------
    >>> import emgface as ef
    >>> ef.sound(vowel="a", source=None)["formant_frequency"].values[0, :2]  # doctest: +SKIP
    """
    from emgface.anatomy.airway.area_function import ideal_vowel, lips_of_trial, with_lips
    from emgface.anatomy.airway.sound import sound_doubts, synthesise, with_formants, write_wave
    from emgface.api.given import dataset_of, target_or_none
    from emgface.errors import ConfigurationError, FeatureWarning, listed

    target = target_or_none(wave)
    if source is None and wave is not None:
        raise ConfigurationError(
            "a wave file needs a source, expected 'folds', 'rosenberg' or a wave file with the flow of "
            "the glottis: name one, or leave the wave file out"
        )
    given = {
        "duration": duration is not None and source is None,
        "lung": lung != 785.0 and source != "folds",
        "tension": tension != 1.0 and source != "folds",
        "pitch": pitch != 120.0 and source != "rosenberg",
    }
    if idle := [name for name, without in given.items() if without]:
        raise ConfigurationError(
            f"{listed(idle)} has no effect with source={source!r}: lung and tension are those of "
            "'folds', the pitch that of 'rosenberg', expected none of another source: leave it out"
        )
    tract = ideal_vowel(vowel)
    if motion is not None:
        tract = with_lips(tract, *lips_of_trial(dataset_of(motion, "trajectory", "mouth_area")))
    lasts = float(tract["time"][-1] - tract["time"][0])
    if motion is not None and duration is not None and duration > lasts + 1e-6:
        raise ConfigurationError(
            f"the motion lasts {lasts:g} s, expected a sound of at most this duration, and "
            f"{duration:g} s was given: leave it out"
        )
    computed = with_formants(tract)
    if source is not None:
        computed = synthesise(
            computed, source, duration=duration, rate=rate, lung=lung, tension=tension, pitch=pitch,
            seed=seed,
        )  # fmt: skip
    if target is not None:
        write_wave(computed, target)
    for text in sound_doubts(computed):
        warnings.warn(text, FeatureWarning, stacklevel=2)
    return computed
