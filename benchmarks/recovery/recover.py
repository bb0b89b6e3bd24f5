"""Recovery of the true activation from simulated EMG by the signal chain."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.stats
import xarray as xr

from emgface.errors import ConfigurationError, SignalError
from emgface.face.template import volunteer_face
from emgface.muscles import CHANNELS, INSTRUCTIONS, MODELLED, MUSCLES
from emgface.signals.activation import activation_of, feature_range
from emgface.signals.parameters import SignalChain
from emgface.volunteers.conduction import Conduction, face_conduction
from emgface.volunteers.emg import Pools, draw_pools, synthesise_emg
from emgface.volunteers.person import SimulatedVolunteer, draw_volunteer
from emgface.volunteers.session import trial_activation, trial_excitation
from emgface.volunteers.settings import VolunteerParameters

LEAST_PEAK: Final = 0.06  #: peak of the true activation above which a muscle takes part in a trial
MEASURES: Final = ("rank_correlation", "error", "shape_error", "false_activation")


@dataclass(frozen=True)
class Condition:
    """Properties of the electrodes of all volunteers."""

    #: root mean square of a channel at full activation over that of its baseline noise [dB]
    snr: float
    #: fraction of a neighbour's amplitude [1]; None if the world models pick-up through the tissue
    cross_talk: float | None = None


def recover(
    conditions: Iterable[Condition],
    chains: Mapping[str, SignalChain],
    *,
    n: int = 3,
    seed: int = 0,
    instructions: Sequence[str] = tuple(INSTRUCTIONS),
    settings: VolunteerParameters | None = None,
) -> xr.Dataset:
    """Compare the activation estimated by signal chains with the true one, for each muscle.

    `chains` are signal chains by name; one that normalises to a reference receives a recording in
    which each muscle is fully active once. `n` volunteers of the set with this `seed` perform each
    of the `instructions` once. `settings` contain world, source of the EMG and length of trials;
    the noise is that of the conditions.

    The result has the dims (condition, chain, muscle, trial), muscle without side, both sides
    averaged; ``rank_correlation`` [1], Spearman's over time; ``error`` [1], root mean square of the
    difference; ``shape_error`` [1], the same after the best scaling of the estimate, over the root
    mean square of the truth; NaN if a muscle does not take part (`LEAST_PEAK`).
    ``false_activation`` [1] is the root mean square of the difference of a muscle that does not
    take part; NaN otherwise. All are NaN if the chain refused the trial. Coords are ``snr`` [dB]
    and ``cross_talk`` [1]; attributes origin "simulated" and world. Raises ConfigurationError if a
    condition has a cross-talk in a world with pick-up through the tissue, or lacks it in another.
    """
    wanted = list(conditions)
    settings = settings or VolunteerParameters()
    through_tissue = settings.world.pick_up == "volume"
    if any((condition.cross_talk is None) != through_tissue for condition in wanted):
        raise ConfigurationError(
            f"the {settings.world.label} has pick_up = '{settings.world.pick_up}': expected conditions "
            f"{'without' if through_tissue else 'with'} a cross-talk"
        )
    people = [draw_volunteer(index, seed) for index in range(1, n + 1)]
    trials = [(person, instruction) for person in people for instruction in instructions]
    shape = (len(wanted), len(chains), len(MODELLED), len(trials))
    found = {name: np.full(shape, np.nan) for name in MEASURES}
    bodies = {person.index: _body(person, settings) for person in people}
    references = any(chain.normalisation.reach == "reference" for chain in chains.values())
    for k, condition in enumerate(wanted):
        extents = {
            (name, person.index): feature_range(
                [_recording(person, full_effort(), condition, settings, bodies[person.index], "")],
                chain,
            )
            for name, chain in chains.items()
            for person in (people if references else [])
            if chain.normalisation.reach == "reference"
        }
        for t, (person, instruction) in enumerate(trials):
            truth = trial_activation(person, instruction, 1, settings)
            excitation = trial_excitation(person, instruction, 1, settings)
            recording = _recording(
                person, excitation, condition, settings, bodies[person.index], instruction
            )
            for c, (name, chain) in enumerate(chains.items()):
                try:
                    estimate = activation_of(
                        recording,
                        chain,
                        strategy="act_all",
                        reference=extents.get((name, person.index)),
                    )["activation"]
                except SignalError:
                    continue  # the chain refuses the trial; its values remain NaN
                for measure, values in _compare(estimate, truth).items():
                    found[measure][k, c, :, t] = values
    dims = ("condition", "chain", "muscle", "trial")
    return xr.Dataset(
        {name: (dims, values, {"units": "1"}) for name, values in found.items()},
        coords={
            "chain": list(chains),
            "muscle": list(MODELLED),
            "trial": [f"{person.name} {instruction}" for person, instruction in trials],
            "snr": ("condition", [one.snr for one in wanted], {"units": "dB"}),
            "cross_talk": (
                "condition",
                [np.nan if one.cross_talk is None else one.cross_talk for one in wanted],
                {"units": "1"},
            ),
        },
        attrs={
            "origin": "simulated",
            "world": settings.world.label,
            "emg": settings.emg,
            "seed": seed,
            "n": n,
        },
    )


def full_effort() -> xr.DataArray:
    """Activation ``(muscle, time_true)`` in which each muscle, on both sides, is fully active once.

    Full activation lasts 0.6 s, and rest 0.4 s.
    """
    rate, rest, period = 1000.0, 0.4, 1.0
    time = np.arange(round(len(MODELLED) * period * rate) + 1) / rate
    values = np.zeros((len(MUSCLES), time.size))
    for k, name in enumerate(MODELLED):
        on = (time >= k * period + rest / 2) & (time < (k + 1) * period - rest / 2)
        for side in ("L", "R"):
            values[MUSCLES.index(f"{name}_{side}"), on] = 1.0
    return xr.DataArray(
        values,
        coords={"muscle": list(MUSCLES), "time_true": ("time_true", time, {"units": "s"})},
        dims=("muscle", "time_true"),
        attrs={"units": "1"},
    )


_Body = tuple[Pools | None, Conduction | None]
"""Motor units of a person, and conduction from the muscles to the electrodes."""


def _body(person: SimulatedVolunteer, settings: VolunteerParameters) -> _Body:
    pools = None
    if settings.emg == "motor_units":
        pools = draw_pools(np.random.default_rng([person.seed, person.index, 7]))
    if settings.world.pick_up == "mapping":
        return pools, None
    face, _ = volunteer_face(
        person.seed,
        person.index,
        resolution=settings.resolution,
        preset=settings.preset,
        spread=settings.spread,
        asymmetry=settings.face_asymmetry,
        course_shift=settings.world.course_shift,
    )
    return pools, face_conduction(face)


def _recording(
    person: SimulatedVolunteer,
    excitation: xr.DataArray,
    condition: Condition,
    settings: VolunteerParameters,
    body: _Body,
    instruction: str,
) -> xr.Dataset:
    """EMG of one trial; all channels have the same ratio of gain to noise."""
    gain = settings.world.amplitude * np.array([person.gain[channel] for channel in CHANNELS])
    place = list(INSTRUCTIONS).index(instruction) if instruction else len(INSTRUCTIONS)
    rng = np.random.default_rng([person.seed, person.index, 11, place])
    pools, conduction = body
    emg = synthesise_emg(
        excitation,
        gain=gain,
        cross_talk=condition.cross_talk or 0.0,
        baseline_noise=0.0,
        mains_hum=person.mains_hum,
        rng=rng,
        sampling_rate=settings.sampling_rate,
        pools=pools,
        conduction=conduction,
    )
    noise = gain[:, None] * 10.0 ** (-condition.snr / 20.0)
    emg = emg + noise * rng.standard_normal(emg.shape)
    attrs = {"origin": "simulated", "world": settings.world.label, "volunteer": person.name}
    if instruction:
        attrs["instruction"] = instruction
    return xr.Dataset({"emg": emg.assign_attrs(units="V")}, attrs=attrs)


def _compare(estimate: xr.DataArray, truth: xr.DataArray) -> dict[str, np.ndarray]:
    """Measures of each muscle, both sides averaged."""
    real = truth.interp(time_true=estimate["time"].values)
    sides = {name: np.full((2, len(MODELLED)), np.nan) for name in MEASURES}
    for s, side in enumerate(("L", "R")):
        for m, muscle in enumerate(MODELLED):
            a = real.sel(muscle=f"{muscle}_{side}").values
            b = estimate.sel(muscle=f"{muscle}_{side}").values
            if a.max() < LEAST_PEAK:
                sides["false_activation"][s, m] = np.sqrt(np.mean((b - a) ** 2))
                continue
            power = float(b @ b)
            factor = float(a @ b) / power if power > 0.0 else 0.0
            sides["error"][s, m] = np.sqrt(np.mean((b - a) ** 2))
            sides["shape_error"][s, m] = np.sqrt(np.mean((factor * b - a) ** 2) / np.mean(a**2))
            # The rank correlation of a constant estimate is undefined; it counts as 0.
            flat = np.ptp(b) == 0.0
            sides["rank_correlation"][s, m] = 0.0 if flat else scipy.stats.spearmanr(a, b)[0]
    with np.errstate(invalid="ignore"):
        return {
            name: np.nansum(values, axis=0) / np.isfinite(values).sum(axis=0)
            for name, values in sides.items()
        }
