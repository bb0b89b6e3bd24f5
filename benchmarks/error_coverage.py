"""Coverage of the estimated error of time stepping on activations from EMG.

    python -m benchmarks error_coverage OUT.csv
    python -m benchmarks error_coverage OUT.csv --contact --preset study --trials 18 --check 2
    python -m benchmarks error_coverage OUT.csv --hard --preset draft --trials 40
    python -m benchmarks error_coverage OUT.csv --contact --closing --preset study --reference 0.00125

Activations are estimated from simulated volunteers' EMG with three strategies, in random order.
With --hard, they are switches, spikes, chirps and square waves at random times (`hard_drives`), and
with --closing rises of both parts of the orbicularis oris, which close the lips (`closing_drives`).
Every trial is simulated without contact, or with that of a study by default (--contact), with each
preset, or fixed steps of SDIRK2 (--preset "5 ms"), and with SDIRK2 in small steps (--reference); the
largest distance of a lip marker over outputs is the true error. With contact, the estimate contains the
error of contact, or the one measured by repeating every motion of a preset with other time steps
(--check-contact; event_mm in the table). Estimates with several factors on the error of contact, and
with an assumed one, follow from the same motion, which is then simulated again without the estimate of
contact for its run time and for the positions, which must be the same. The first trials (--check) are
also simulated with half of the small steps, which are then their reference, and the difference of both
references is printed. Writes one row per trial and preset, and prints, per preset, the fractions of
trials whose true error is at most the estimate or the tolerance, medians and the largest error.
"""

import time
import warnings
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from analysis.scores import correlation_3d
from benchmarks.hard_drives import closing_drives, hard_drives
from benchmarks.report import markdown
from emgface.children import safe_children
from emgface.choices import configure
from emgface.face.accuracy import accuracy_settings
from emgface.face.event_error import (
    CONTACT_FORCE,
    ERRORS,
    TOUCHING,
    ContactForce,
    assumed,
    estimated,
    touched,
)
from emgface.face.motion import settle_face, simulate_face
from emgface.face.numerical_error import numerical_error
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template import template_face
from emgface.muscles import CHANNELS, INSTRUCTIONS
from emgface.signals.activation import activation_of
from emgface.signals.parameters import SignalChain
from emgface.volunteers.emg import draw_pools, synthesise_emg
from emgface.volunteers.person import draw_volunteer
from emgface.volunteers.session import trial_activation
from emgface.volunteers.settings import VolunteerParameters
from sim import StepErrors
from sim.errors import SimulationError
from sim.integrators.stage import Converged
from sim.probes import Probe, Report, Values, Variable
from sim.state import Control, State
from sim.system import System

PRESETS = ("study", "draft", "published")
STRATEGIES = ("act_all", "act_3", "act_rel")
VOLUNTEERS, SEED = 6, 0
SNR = 20.0  # dB
OUTPUT = 0.01  # s
FREE: dict[str, object] = {"contact": {"method": "none"}}
FACTORS = (1.0, 1.5, 2.0, 3.0)  #: on the estimated error of contact
KEPT = "kept_"  #: prefix of the variables of `Kept`
KINDS = ("step_error", "iteration_error", "input_error", "passing_error")


def emg_trials() -> Iterator[tuple[str, xr.DataArray, xr.DataArray]]:
    """Label, activation estimated from simulated EMG, and the true one, in random order."""
    settings = VolunteerParameters(duration=1.0)
    signals = configure(SignalChain, {"normalisation": {"silent": "zero"}})
    wanted = [(i, x, s) for i in range(1, VOLUNTEERS + 1) for x in INSTRUCTIONS for s in STRATEGIES]
    for k in np.random.default_rng(SEED).permutation(len(wanted)):
        index, instruction, strategy = wanted[k]
        person = draw_volunteer(index, SEED)
        truth = trial_activation(person, instruction, 1, settings)
        gain = np.array([person.gain[channel] for channel in CHANNELS])
        rng = np.random.default_rng([SEED, index, 11, list(INSTRUCTIONS).index(instruction)])
        emg = synthesise_emg(
            truth,
            gain=gain,
            cross_talk=person.cross_talk,
            baseline_noise=0.0,
            mains_hum=person.mains_hum,
            rng=rng,
            sampling_rate=settings.sampling_rate,
            pools=draw_pools(np.random.default_rng([SEED, index, 7])),
        )
        noise = gain[:, None] * 10.0 ** (-SNR / 20.0) * rng.standard_normal(emg.shape)
        recording = xr.Dataset(
            {"emg": (emg + noise).assign_attrs(units="V")},
            attrs={"origin": "simulated", "volunteer": person.name, "instruction": instruction},
        )
        label = f"{person.name} {instruction} {strategy}"
        estimated = activation_of(recording, signals, strategy=strategy)["activation"]
        yield label, estimated, truth.rename(time_true="time")


@dataclass(frozen=True, eq=False)
class Kept:
    """Probe under other names, which a simulation does not remove from its result."""

    probe: Probe
    reads_errors = True

    def variables(self) -> tuple[Variable, ...]:
        """Those of the probe with a prefix."""
        return tuple(replace(each, name=KEPT + each.name) for each in self.probe.variables())

    def record(self, system: System, state: State, control: Control, report: Report) -> Values:
        """As the probe."""
        return self.probe.record(system, state, control, report)


@contextmanager
def unestimated() -> Generator[None]:
    """Steps without the estimate of contact for a while, as before it was introduced."""
    own = Converged._of_contact
    Converged._of_contact = lambda *_: None
    try:
        yield
    finally:
        Converged._of_contact = own


Job = tuple[str, xr.DataArray, xr.DataArray | None, bool]
"""Label, activation, true activation, and if the reference is checked."""


class Bench:
    """A settled face on which every trial of a process is simulated."""

    one: "Bench"

    def __init__(
        self,
        presets: tuple[str, ...],
        contact: bool,
        check_contact: bool,
        reference: float,
        duration: float,
    ) -> None:
        warnings.simplefilter("ignore")
        self.presets, self.face = presets, template_face(resolution="coarse")
        self.checked: dict[str, object] = {"check_contact": check_contact}
        self.base: dict[str, object] = {"sigma_max": 100e3, "output": OUTPUT}
        self.base |= {} if contact else FREE
        self.contact, self.reference, self.duration = contact, reference, duration
        nodes = self.face["marker_node"].values.astype(np.int64)
        names = tuple(map(str, self.face["marker"].values))
        self.watched = (Kept(StepErrors(nodes, names)), Kept(ContactForce()))
        self.settled: dict[bool, xr.Dataset] = {}
        Bench.one = self

    def moved(
        self, drive: xr.DataArray, values: dict[str, object], *, watch: bool = False
    ) -> xr.Dataset:
        """Motion of the face, with the errors of its steps if they are watched."""
        parameters = configure(SimulationParameters, self.base | values)
        free = parameters.contact.method == "none"
        if free not in self.settled:
            self.settled[free] = settle_face(self.face, parameters)
        chosen = drive.sel(muscle=self.face["muscle"].values.tolist())
        if self.duration:
            begin = float(chosen["time"][0])
            chosen = chosen.sel(time=slice(begin, begin + self.duration + 1e-9))
        further, settled = self.watched if watch else (), self.settled[free]
        return simulate_face(self.face, chosen, parameters, settled=settled, further=further)

    def several(self, motion: xr.Dataset) -> dict[str, object]:
        """Largest estimate [mm] of a watched motion by factor, and with an assumed error of contact."""
        memory = configure(SimulationParameters, self.base).beta
        step, *others = (motion[KEPT + kind] for kind in KINDS)
        own = numerical_error(step, memory, *others).values
        touching = touched(*(motion[KEPT + name].values for name in (CONTACT_FORCE, TOUCHING)))
        of_contact = estimated(*(motion[KEPT + name] for name in ERRORS), memory)
        estimates = {f"{f:g} x contact": own + f * of_contact for f in FACTORS}
        estimates |= {"assumed contact": own + assumed(motion["position"], touching)}
        return {name: 1e3 * float(values.max()) for name, values in estimates.items()}

    def exact(self, drive: xr.DataArray, step: float) -> xr.DataArray:
        """Positions of the lip markers with SDIRK2 in small steps."""
        small = {"solver": "sdirk2", "step": step, "iteration_tolerance": 1e-6}
        return self.moved(drive, small)["position"]

    def rows(self, job: Job) -> list[dict[str, object]]:
        """One row per preset of a trial."""
        label, drive, truth, checked = job
        exact = self.exact(drive, self.reference)
        known = np.nan
        if checked:
            finer = self.exact(drive, 0.5 * self.reference)
            known = 1e3 * float(np.sqrt(((exact - finer) ** 2).sum("axis")).max())
            exact = finer
        signal = float(np.sqrt(((exact - exact.isel(time=0)) ** 2).sum("axis")).max())
        goal = None
        if truth is not None:
            span = truth.sel(time=slice(float(drive["time"][0]), float(drive["time"][-1])))
            goal = self.moved(span, FREE | {"accuracy": "draft"})["position"]
        table: list[dict[str, object]] = []
        for preset in self.presets:
            row: dict[str, object] = {"trial": label, "preset": preset, "motion_mm": 1e3 * signal}
            row["reference_mm"] = known
            table.append(row)
            started = time.process_time()
            try:
                chosen = self.checked | _settings(preset)
                motion = self.moved(drive, chosen, watch=self.contact)
            except SimulationError as error:
                row["status"] = type(error).__name__
                continue
            row["processor_s_per_s"] = (time.process_time() - started) / float(motion["time"][-1])
            if self.contact:
                row |= self.several(motion)
                row |= self.before(drive, chosen, motion)
            here = motion["position"].assign_coords(time=exact["time"])
            row["status"] = "ok"
            row["error_mm"] = 1e3 * float(np.sqrt(((here - exact) ** 2).sum("axis")).max())
            row["estimate_mm"] = 1e3 * motion.attrs.get("numerical_error", np.nan)
            row["event_mm"] = 1e3 * motion.attrs.get("event_error", 0.0)
            row["largest ratio of instants"] = _worst(motion, exact)
            row["steps"] = float(motion["steps"].sum())
            row["iterations"] = float(motion["iterations"].sum())
            if goal is not None:
                n = min(goal.sizes["time"], exact.sizes["time"])
                three = (
                    d.isel(time=slice(0, n)).assign_coords(time=exact["time"][:n])
                    for d in (goal, here, exact)
                )
                to, a, b = three
                row["change_of_rho"] = float(
                    np.abs(correlation_3d(to, a) - correlation_3d(to, b)).max()
                )
        return table

    def before(
        self, drive: xr.DataArray, chosen: dict[str, object], motion: xr.Dataset
    ) -> dict[str, object]:
        """Run time without the estimate of contact, and if the motion is the same."""
        started = time.process_time()
        with unestimated():
            other = self.moved(drive, chosen, watch=True)
        seconds = time.process_time() - started
        same = bool((other["position"].values == motion["position"].values).all())
        return {"s/s before": seconds / float(motion["time"][-1]), "same motion": same}


def _settings(preset: str) -> dict[str, object]:
    """Parameters of a preset, or of fixed steps of SDIRK2 such as "5 ms"."""
    if not preset.endswith(" ms"):
        return {"accuracy": preset}
    fixed = {"solver": "sdirk2", "step": 1e-3 * float(preset.removesuffix(" ms"))}
    return accuracy_settings("study") | fixed | {"error_tolerance": None}


def _worst(motion: xr.Dataset, exact: xr.DataArray) -> float:
    """Largest ratio of the error of a marker to the estimate over the outputs with errors over 1 um."""
    if "numerical_error" not in motion:
        return float("nan")
    here = motion["position"].assign_coords(time=exact["time"])
    error = np.sqrt(((here - exact) ** 2).sum("axis")).max("marker").values
    estimate = motion["numerical_error"].values
    large = error > 1e-6
    return float((error[large] / estimate[large]).max(initial=0.0))


def _trial_rows(job: Job) -> list[dict[str, object]]:
    return Bench.one.rows(job)


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """One row per preset."""
    summaries: list[dict[str, object]] = []
    for preset, group in rows.groupby("preset", sort=False):
        ok = group[group["status"] == "ok"]
        ratio = ok["estimate_mm"] / ok["error_mm"]
        summaries.append(
            {
                "preset": preset,
                "trials": len(group),
                "failed": len(group) - len(ok),
                "error of reference mm": group["reference_mm"].max(),
                "median motion mm": ok["motion_mm"].median(),
                "median error mm": ok["error_mm"].median(),
                "worst error mm": ok["error_mm"].max(),
                "within 0.1 mm": (ok["error_mm"] <= 0.1).mean(),
                **_of_rho(ok),
                **_of_contact(ok),
                "error <= estimate": (ratio >= 1.0).mean(),
                "median estimate/error": ratio.median(),
                "smallest estimate/error": ratio.min(),
                "estimate >= error at all outputs": (ok["largest ratio of instants"] <= 1.0).mean(),
                "median s/s": ok["processor_s_per_s"].median(),
            }
        )
    return pd.DataFrame(summaries).round(4)


def _of_contact(ok: pd.DataFrame) -> dict[str, object]:
    """Coverage, median ratio and least ratio of every estimate of a motion with contact."""
    if "same motion" not in ok:
        return {}
    columns: dict[str, object] = {}
    for name in (*(f"{f:g} x contact" for f in FACTORS), "assumed contact"):
        ratio = ok[name] / ok["error_mm"]
        text = f"{(ratio >= 1.0).mean():.0%}, {ratio.median():.2f}, {ratio.min():.2f}"
        columns[f"{name}: covers, median, least"] = text
    cost = ok["processor_s_per_s"] / ok["s/s before"]
    return columns | {"time over before": cost.median(), "same motion": ok["same motion"].all()}


def _of_rho(ok: pd.DataFrame) -> dict[str, object]:
    """Changes of rho, of drives with a known true activation."""
    if "change_of_rho" not in ok:
        return {}
    change = ok["change_of_rho"].dropna()
    return {"change of rho <= 0.01": (change <= 0.01).mean(), "worst change of rho": change.max()}


def main(
    out: Path,
    preset: list[str] = list(PRESETS),  # noqa: B006
    contact: bool = False,
    check_contact: bool = False,
    trials: int = 0,
    check: int = 0,
    workers: int = 2,
    hard: bool = False,
    closing: bool = False,
    seed: int = 0,
    skip: int = 0,
    reference: float = OUTPUT / 4,
    duration: float = 0.0,
) -> None:
    """Measure recordings of a second, store after every trial, print.

    `trials` limits their number (0: all, 40 with `hard`), after those to `skip`. `check_contact` repeats
    every motion, as the parameter of a study does. `seed` selects another set of `hard` or `closing`
    drives. `reference` is the small step [s]; `duration` [s] cuts the trials (0: whole).
    """
    warnings.simplefilter("ignore")
    muscles: list[str] = template_face(resolution="coarse")["muscle"].values.tolist()
    of_muscles = closing_drives if closing else hard_drives
    drives = of_muscles(muscles, seed) if hard or closing else emg_trials()
    most = trials or (40 if hard or closing else None)
    chosen = enumerate(islice(drives, skip, None if most is None else skip + most))
    marked: Iterator[Job] = (
        (label, drive, truth, k < check) for k, (label, drive, truth) in chosen
    )
    rows: list[dict[str, object]] = []
    begin = (tuple(preset), contact, check_contact, reference, duration)
    with safe_children(), get_context("spawn").Pool(workers, Bench, begin) as pool:
        for trial_rows in pool.imap(_trial_rows, marked):
            rows += trial_rows
            pd.DataFrame(rows).to_csv(out, index=False)
    print(markdown(summary(pd.DataFrame(rows))))
