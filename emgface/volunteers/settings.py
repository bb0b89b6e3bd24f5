"""Parameters of simulated volunteers."""

from typing import Literal

from pydantic import Field

from emgface.choices import ESKES, THIS_PACKAGE, Parameters, choice, parameter
from emgface.face.template.resolution import Resolution
from emgface.face.template.volunteers import GROUP_PRESETS
from emgface.volunteers.world import MISMATCHED, World

VAN_BOXTEL = "van Boxtel 2001, Psychophysiology 38:22-34"


class VolunteerParameters(Parameters):
    """Parameters of faces, sessions, electrodes and cameras of simulated volunteers."""

    world: World = Field(
        default=MISMATCHED,
        description="Differences between the volunteers and the assumptions of a study.",
    )
    emg: Literal["motor_units", "noise"] = choice(
        "motor_units",
        "Source of the EMG: action potentials of motor units, or amplitude-modulated noise.",
        note="with motor units, the amplitude is approximately proportional to the activation",
    )
    resolution: Resolution = parameter(
        "medium",
        "Number of elements of the random faces: coarse, medium, fine, or an approximate number.",
        note="finer than that of the study, so that the errors of both differ",
    )
    preset: str = choice("adult", f"Group of people: {', '.join(GROUP_PRESETS)}.")
    spread: float = parameter(1.0, "Factor on the published spread of the measures of faces.", ge=0)
    face_asymmetry: float = parameter(
        1.0, "Factor on the spread of the differences between the sides.", ge=0
    )
    duration: float = parameter(
        1.8, "Length of a trial.", unit="s", gt=0.2, le=60.0,
        note="160 steps of 10 ms and half a window of 200 ms at each end"
    )  # fmt: skip
    rest: float = parameter(
        2.0, "Shortest rest before, between and after repetitions.", unit="s",
        source=f"{ESKES}, Methods", ge=0.25, le=60.0, note="rounded up to multiples of 0.25 s"
    )  # fmt: skip
    sampling_rate: float = parameter(
        2048.0, "Sampling rate of the EMG.", unit="Hz", source=f"{ESKES}, Methods", gt=1000.0
    )
    frame_rate: float = parameter(
        100.0, "Frames per second of the cameras.", unit="Hz", source=f"{ESKES}, Methods", gt=0
    )
    cameras: Literal["three", "direct"] = choice(
        "three",
        "Markers triangulated from three calibrated cameras, or positions with added noise.",
        source=f"{ESKES}, Methods",
    )
    pixel_noise: float = parameter(
        0.1, "Standard deviation of the position of a marker in an image.", unit="pixel", ge=0
    )
    occlusions: float = parameter(
        0.05, "Number of losses of a marker per second, each of 20 to 80 ms.", unit="1/s", ge=0
    )
    cross_talk: float | None = parameter(
        None,
        "Fraction of the amplitude of neighbouring channels if world.pick_up = 'mapping'; "
        "default: random for each volunteer.",
        ge=0,
        lt=0.5,
    )
    noise_factor: float = parameter(1.0, "Factor on the baseline noise of the electrodes.", ge=0)
    mains_frequency: float = parameter(50.0, "Frequency of the mains hum.", unit="Hz", gt=0)
    artefact_probability: float = parameter(
        0.1, "Probability of a movement artefact per channel and repetition.", ge=0, le=1
    )
    artefact_amplitude: float = parameter(
        100e-6,
        "Median peak of movement artefacts, whose frequencies are below the pass-band.",
        unit="V",
        source=f"{THIS_PACKAGE}; {VAN_BOXTEL} for the band",
        ge=0,
    )
    electrode_failure: float = parameter(
        0.0,
        "Probability that an electrode pair fails during a session.",
        note="a trial with a failed pair cannot be used in a study; it serves to test the checks",
        ge=0,
        le=1,
    )

    keep_sessions: bool = choice(
        False, "Also write each uncut session, with rests, and its events in the format of BIDS."
    )
