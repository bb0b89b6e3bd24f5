"""Recovery of the true activation by the signal chain with noise and cross-talk, as a figure.

    python -m benchmarks recovery FIGURE.png [--n 3]

Activations are estimated from simulated EMG of known activations; estimate and truth are compared
for each muscle by Spearman's rank correlation over time and the root-mean-square error. Noise and
cross-talk are varied in the matched world, noise in the mismatched one, in which electrodes pick up
all muscles through the tissue and the truth is the activation, which lags the EMG. Writes the
figure and its values.
"""

import warnings
from pathlib import Path

import numpy as np
import xarray as xr

from analysis.figures.style import COLOURS, MARKS, SHADES, blank, styled
from benchmarks.recovery.recover import Condition, recover
from emgface.choices import configure
from emgface.signals.parameters import SignalChain
from emgface.volunteers.settings import VolunteerParameters
from emgface.volunteers.world import MATCHED, MISMATCHED

SNR = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0)
CROSS_TALK = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4)
USUAL = Condition(40.0, 0.05)
ZERO = {"silent": "zero"}
CHAINS = {
    "WAMP 10 uV, per trial": {"normalisation": ZERO},
    "RMS, per trial": {"feature": {"kind": "rms"}, "normalisation": ZERO},
    "WAMP 10 uV, reference": {"normalisation": ZERO | {"reach": "reference", "outside": "clip"}},
    "RMS, reference": {
        "feature": {"kind": "rms"},
        "normalisation": ZERO | {"reach": "reference", "outside": "clip"},
    },
}
SHOWN = {"rank_correlation": "rank correlation", "error": "activation error (RMS)"}
FALSE = "false activation (RMS)"


def sweep(found, axis, conditions):
    """Select the conditions of one sweep."""
    return found.isel(condition=[conditions.index(c) for c in axis])


@styled
def draw(noise: xr.Dataset, mixed: xr.Dataset, other: xr.Dataset):
    """Heat maps per muscle for the first chain, then medians over muscles for all chains."""
    figure = blank(13.5, 12.5)
    axes = figure.subplots(5, 3, height_ratios=(2.3, 1.6, 2.3, 1.6, 1.6))
    columns = (
        (noise, "snr", "signal-to-noise ratio [dB], matched world"),
        (mixed, "cross_talk", "cross-talk, matched world"),
        (other, "snr", "signal-to-noise ratio [dB], mismatched world"),
    )
    for row, (name, title) in enumerate(SHOWN.items()):
        for panel, line, (found, coord, label) in zip(
            axes[2 * row], axes[2 * row + 1], columns, strict=True
        ):
            ticks = [f"{v:g}" for v in found[coord].values]
            per_muscle = found[name].isel(chain=0).median("trial").transpose("muscle", "condition")
            limits = (0.0, 1.0) if name == "rank_correlation" else (0.0, 0.6)
            image = panel.imshow(
                per_muscle, aspect="auto", cmap=SHADES, vmin=limits[0], vmax=limits[1]
            )
            middle = 0.5 * sum(limits)
            for (i, j), value in np.ndenumerate(per_muscle.values):
                colour = "white" if value < middle else "black"
                text = "-" if np.isnan(value) else f"{value:.2f}"
                panel.text(j, i, text, ha="center", va="center", fontsize=6.5, color=colour)
            panel.set_xticks(range(len(ticks)), ticks)
            panel.set_yticks(range(found.sizes["muscle"]), found["muscle"].values)
            world = str(found.attrs["world"])
            panel.set_title(f"{title}, {found['chain'].values[0]},\nmedian over trials, {world}")
            figure.colorbar(image, ax=panel, fraction=0.04)
            for k, chain in enumerate(found["chain"].values):
                over = found[name].isel(chain=k)
                spread = over.median("trial").quantile([0.25, 0.5, 0.75], "muscle")
                line.plot(
                    range(len(ticks)), spread[1], marker=MARKS[k], color=COLOURS[k], label=chain
                )
                line.fill_between(
                    range(len(ticks)), spread[0], spread[2], color=COLOURS[k], alpha=0.12
                )
            line.set_xticks(range(len(ticks)), ticks)
            line.set_xlabel(label)
            line.set_ylabel(title)
            line.set_ylim(*limits)
    for line, (found, coord, label) in zip(axes[4], columns, strict=True):
        ticks = [f"{v:g}" for v in found[coord].values]
        for k, _ in enumerate(found["chain"].values):
            wrong = found["false_activation"].isel(chain=k).median("trial").median("muscle")
            line.plot(range(len(ticks)), wrong, marker=MARKS[k], color=COLOURS[k])
        line.set_xticks(range(len(ticks)), ticks)
        line.set_xlabel(label)
        line.set_ylabel(FALSE)
        line.set_ylim(0.0, 0.6)
        line.set_title("muscles that take no part in the movement")
    axes[1, 0].legend(ncols=2, loc="lower right", fontsize=7)
    axes[1, 1].set_title("medians over muscles, shaded the quartiles")
    figure.suptitle("Activation recovered from SIMULATED EMG")
    return figure


def main(out: Path, n: int = 3) -> None:
    """Compute, draw and print."""
    noisy = [Condition(snr, USUAL.cross_talk) for snr in SNR]
    mixing = [Condition(USUAL.snr, share) for share in CROSS_TALK]
    conditions = list(dict.fromkeys([*noisy, *mixing]))
    chains = {name: configure(SignalChain, values) for name, values in CHAINS.items()}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found, other = (
            recover(
                wanted, chains, n=n, seed=0,
                settings=VolunteerParameters(emg="motor_units", world=world, resolution="coarse"),
            )
            for world, wanted in (
                (MATCHED, conditions),
                (MISMATCHED, [Condition(snr) for snr in SNR]),
            )
        )  # fmt: skip
    out.parent.mkdir(parents=True, exist_ok=True)
    found.to_netcdf(out.with_suffix(".nc"))
    other.to_netcdf(out.with_suffix(".mismatched.nc"))
    noise, mixed = sweep(found, noisy, conditions), sweep(found, mixing, conditions)
    draw(noise, mixed, other).savefig(out, dpi=130)
    for part, coord in ((noise, "snr"), (mixed, "cross_talk"), (other, "snr")):
        for name in (*SHOWN, "false_activation"):
            table = part[name].median("trial").median("muscle").to_pandas()
            table.index = part[coord].values
            print(f"\n{name} against {coord} (median over trials and muscles), simulated, "
                  f"{part.attrs['world']}")  # fmt: skip
            print(table.round(3).to_string())
