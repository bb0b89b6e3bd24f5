"""Results that sentences state, rebuilt from the tables that a command wrote next to them.

`meanings`, `conclusions_of` and `choices_of` compute the sentences again, from the CSV alone. A sentence
that differs from its table is then not among them.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from analysis.baseline_tables import HEADS, what_rho_means
from analysis.robustness import robustness_sentences
from analysis.statistics.skill import CORRELATIONS
from analysis.statistics.summary import conclusions

BOUNDS = ["lower", "upper"]
GAINS = {
    "gain_template": "gain over all persons", "gain_others": "gain over EMG of others",
    "gain_shuffled": "gain by own EMG", "gain_room": "largest gain by own EMG",
    "skill": "skill", "skill_others": "skill without own EMG",
}  # fmt: skip


def words(text: str) -> str:
    """Text with single blanks, because pages are wrapped."""
    return " ".join(text.split())


def meanings(path: Path) -> list[str]:
    """Sentences of `what_rho_means` from the table of baselines."""
    table = pd.read_csv(path)
    dataset = xr.Dataset(coords={"strategy": table["strategy"].tolist(), "bound": BOUNDS})
    for name, head in zip(CORRELATIONS, HEADS, strict=True):
        dataset[name] = ("strategy", table[head].to_numpy(float))
    for name, head in GAINS.items():
        dataset[name] = ("strategy", table[head].to_numpy(float))
        bounds = table[[f"{head}, {bound}" for bound in BOUNDS]].to_numpy(float)
        dataset[f"{name}_interval"] = (("strategy", "bound"), bounds)
    for name in ("volunteers", "trials"):
        dataset[name] = ("strategy", table[name].to_numpy())
    dataset["template_volunteers"] = float(table["volunteers"].max()) - 1.0
    return what_rho_means(dataset.assign_attrs(level=0.95, origin=table["origin"][0]))


def conclusions_of(path: Path, *, together: bool = False) -> list[str]:
    """Sentences of `conclusions` from the table of tests."""
    table = pd.read_csv(path)
    parts = {"sign_flip": ("sign flip", "these"), "mixed_model": ("mixed model", "in general")}
    heads = {
        "estimate": "estimate", "p": "p", "p_holm": "p Holm", "p_joint": "p joint",
        "smallest_p": "smallest p", "n": "volunteers", "standard_deviation": "standard deviation",
    }  # fmt: skip
    datasets: dict[str, xr.Dataset] = {}
    for name, (test, scope) in parts.items():
        own = table[(table["test"] == test) & (table["instructions"] == scope)]
        assert len(own), (test, scope)
        attrs = {
            "level": 0.95,
            "variable": "rho",
            "scale": "Fisher z",
            "origin": own["origin"].iloc[0],
        }
        datasets[name] = xr.Dataset(
            {key: ("contrast", own[head].to_numpy(float)) for key, head in heads.items()},
            coords={"contrast": own["contrast"].tolist()},
            attrs=attrs,
        )
        datasets[name]["sentence"] = ("contrast", [""] * len(own))
    return conclusions(datasets, together=together)


def choices_of(path: Path) -> list[str]:
    """Sentences of `robustness_sentences` from the table of conclusions."""
    table = pd.read_csv(path, dtype={"level": str})
    strategies = list(dict.fromkeys(table["strategy"]))
    places = list(dict.fromkeys(zip(table["axis"], table["level"], strict=True)))
    shape = (len(places), len(strategies))
    dims = ("choice", "strategy")

    def column(head: str) -> np.ndarray:
        values = pd.to_numeric(table[head], errors="coerce").to_numpy(float)
        return values.reshape(shape)

    dataset = xr.Dataset(
        {
            "median": (dims, column("median rho")),
            "rank": (dims, column("rank")),
            "gain_interval": ((*dims, "bound"), np.stack([column(one) for one in BOUNDS], axis=-1)),
            "axis": ("choice", [axis for axis, _ in places]),
            "level": ("choice", ["" if level == "-" else level for _, level in places]),
        },
        coords={"strategy": strategies, "bound": BOUNDS},
    )
    return robustness_sentences(dataset)
