"""Published jaw model: which outcomes one set of unstated parameters can meet, and what decides each.

A part of ``python -m benchmarks jaw``; it needs the published model. Independent sets are drawn from the
prior of `benchmarks.jaw_sets`. The nearest of them are a sample of the posterior (approximate Bayesian
computation by rejection), with the largest excess of an outcome over its published range as distance,
in units of 10 % of that outcome. An event that none of n sets shows has at most 1 - 0.05^(1/n) of the
mass of the prior, with 95 % confidence. Such a share does not exclude single sets:
`benchmarks.jaw_search` looks for them from the nearest sets, for all outcomes, for each pair that no set
meets, and for all but one of the outcomes that bind the nearest set.
"""

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.jaw_search import Found, largest, nearest
from benchmarks.jaw_sets import PRIOR, WANTED, Sets, Values, excess, without_numbers
from benchmarks.report import say

KEPT = 0.05
"""Share of the sets that is the sample of the posterior."""
SEARCHED, STARTS = 1024, 3
"""Number of the first sets from which searches start, and of starts on each condylar path."""
ALL = tuple(WANTED)


class Pool:
    """All sets whose outcomes are known, by their parameters."""

    def __init__(self, sets: Sets) -> None:
        self._sets, self.known = sets, list[tuple[Values, Values]]()

    def outcomes(self, own: Values) -> Values:
        """Outcomes of a set, which is then known."""
        self.known.append((own, self._sets.outcomes(own)))
        return self.known[-1][1]

    def best(self, wanted: Sequence[str], curved: bool | None = None) -> Values:
        """Known set with the smallest largest excess of some outcomes, on one path or any."""
        chosen = [k for k in self.known if curved in (None, k[0]["curved path"] >= 0.5)]
        return min(chosen, key=lambda one: largest(one[1], wanted))[0]


def posterior(samples: int, out: Path) -> dict[str, pd.DataFrame]:
    """Tables of outcomes, parameters, pairs and searches; a figure and all sets are in the folder."""
    sets = Sets(out / "jaw_sets.csv")
    pool = Pool(sets)
    low, high = np.array(list(PRIOR.values())).T
    drawn = np.random.default_rng(3).uniform(low, high, (samples, len(low)))
    rows = list[Values]()
    for k, x in enumerate(drawn[:SEARCHED].tolist()):
        rows.append(_row(pool, dict(zip(PRIOR, x, strict=True))))
        if k % 64 == 63:
            say(f"{k + 1} of {samples}: nearest {min(r['distance'] for r in rows):.2f}")
    found = searches(pool, pd.DataFrame(rows))
    rows += [_row(pool, dict(zip(PRIOR, x, strict=True))) for x in drawn[SEARCHED:].tolist()]
    prior = pd.DataFrame(rows)
    counts, joint = pairs(prior, pool)
    figure(prior, counts, joint, found, out)
    others = {
        path: without_numbers(sets.model(own), own)
        for path in ("planes", "curve")
        for own in [found[f"all, {path}"].own]
    }
    return {
        "outcomes": outcome_table(prior, found),
        "others": pd.DataFrame(others).round(3).reset_index(names="nearest sets"),
        "parameters": parameter_table(prior, found),
        "pairs": pair_table(counts, joint),
        "searches": search_table(found, len(prior)),
    }


def _row(pool: Pool, own: Values) -> Values:
    outcomes = pool.outcomes(own)
    return own | outcomes | {"distance": largest(outcomes, ALL)}


def met(sets: pd.DataFrame) -> pd.DataFrame:
    """Table with True where a set (row) meets the published range of an outcome (column)."""
    return pd.DataFrame({n: sets[n].between(low, high) for n, (low, high) in WANTED.items()})


def searches(pool: Pool, prior: pd.DataFrame) -> dict[str, Found]:
    """Results by what was searched."""
    found, whole = dict[str, Found](), list[Found]()
    for name, curved in (("planes", False), ("curve", True)):
        own = prior[(prior["curved path"] >= 0.5) == curved].nsmallest(STARTS, "distance")
        tries = [nearest(pool.outcomes, {n: float(r[n]) for n in PRIOR}) for _, r in own.iterrows()]
        found[f"all, {name}"] = min(tries, key=lambda one: one.far)
        say(f"all, {name}: " + ", ".join(f"{one.far:.3f}" for one in tries))
        whole.append(found[f"all, {name}"])
    best = min(whole, key=lambda one: one.far)
    for one in best.binding:
        rest = tuple(n for n in ALL if n != one)
        found[f"all but {one}"] = nearest(pool.outcomes, pool.best(rest), rest)
        say(f"all but {one}: {found[f'all but {one}'].far:.3f}")
    reached = met(prior)
    for a, b in combinations(ALL, 2):
        if (reached[a] & reached[b]).any():
            continue
        tries = list[Found]()
        for curved in (True, False):
            if not tries or tries[0].far > 0.0:
                tries.append(nearest(pool.outcomes, pool.best((a, b), curved), (a, b)))
        found[f"{a} and {b}"] = min(tries, key=lambda one: one.far)
        say(f"{a} and {b}: {found[f'{a} and {b}'].far:.3f}")
    return found


def pairs(prior: pd.DataFrame, pool: Pool) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Number of sets of the prior that meet both outcomes, and the smallest excess in any known set."""
    reached, n = met(prior).to_numpy(dtype=int), len(ALL)
    counts = pd.DataFrame(reached.T @ reached, index=ALL, columns=ALL)
    far = np.array([[excess(outcomes)[n] for n in ALL] for _, outcomes in pool.known])
    far = np.where(np.isfinite(far), far, np.inf)
    joint = np.array([[np.maximum(far[:, i], far[:, j]).min() for j in range(n)] for i in range(n)])
    return counts, pd.DataFrame(joint, index=ALL, columns=ALL)


def pair_table(counts: pd.DataFrame, joint: pd.DataFrame) -> pd.DataFrame:
    """Numbers of sets; where there are none, the smallest excess that was found."""
    cells = {
        b: [
            str(counts.loc[a, b]) if counts.loc[a, b] else f"0 ({joint.loc[a, b]:.2f})" for a in ALL
        ]
        for b in ALL
    }
    return pd.DataFrame({"outcome": ALL, **cells})


def share(count: int, n: int) -> str:
    """Share of the prior, or its upper bound with 95 % confidence if no set shows an event."""
    return f"{count / n:.2g}" if count else f"< {1.0 - 0.05 ** (1.0 / n):.2g}"


def _between(values: pd.Series) -> str:
    return " to ".join(f"{x:.3g}" for x in np.nanquantile(values, [0.05, 0.95]))


def nearest_sets(prior: pd.DataFrame) -> pd.DataFrame:
    """Sample of the posterior."""
    return prior.nsmallest(round(KEPT * len(prior)), "distance")


def outcome_table(prior: pd.DataFrame, found: dict[str, Found]) -> pd.DataFrame:
    """Outcomes of prior, posterior and the nearest sets beside the published ones."""
    near, reached = nearest_sets(prior), met(prior)
    at_once = reached.sum(axis=1)
    say(
        f"{len(prior)} sets, {int(prior['rest'].isna().sum())} without outcomes; most met at once: "
    )
    say(f"{at_once.value_counts().sort_index().to_dict()}; distance {near['distance'].max():.2f}")
    say(f"all within 10 % beyond: {share(int((prior['distance'] <= 1.0).sum()), len(prior))}")
    return pd.DataFrame(
        {
            "outcome": name,
            "published": f"{low:g} to {high:g}",
            "prior, 90 %": _between(prior[name]),
            "posterior, 90 %": _between(near[name]),
            "met by": share(int(reached[name].sum()), len(prior)),
            **{
                f"nearest, {path}": f"{found[f'all, {path}'].outcomes[name]:.3g}"
                for path in ("planes", "curve")
            },
        }
        for name, (low, high) in WANTED.items()
    )


def parameter_table(prior: pd.DataFrame, found: dict[str, Found]) -> pd.DataFrame:
    """Parameters of prior, posterior and the nearest sets."""
    near = nearest_sets(prior)
    return pd.DataFrame(
        {
            "parameter": name,
            "prior": f"{low:g} to {high:g}",
            "posterior, 90 %": _between(near[name]),
            "spread / prior": f"{near[name].std() * 12**0.5 / (high - low):.2f}",
            **{
                f"nearest, {path}": f"{found[f'all, {path}'].own[name]:.3g}"
                for path in ("planes", "curve")
            },
        }
        for name, (low, high) in PRIOR.items()
    )


def search_table(found: dict[str, Found], n: int) -> pd.DataFrame:
    """Smallest excess of every group of outcomes, what binds it, and parameters at a bound."""
    say(f"no set meets a group: at most {share(0, n)} of the prior")
    return pd.DataFrame(
        {
            "outcomes": name,
            "path": "curve" if one.own["curved path"] >= 0.5 else "planes",
            "smallest excess": f"{one.far:.2f}",
            "binding": ", ".join(one.binding),
            "at a bound of the prior": ", ".join(
                n
                for n, (low, high) in PRIOR.items()
                if n != "curved path" and min(one.own[n] - low, high - one.own[n]) < 1e-6
            ),
        }
        for name, one in found.items()
    )


def figure(
    prior: pd.DataFrame,
    counts: pd.DataFrame,
    joint: pd.DataFrame,
    found: dict[str, Found],
    out: Path,
) -> None:
    """Draw rank correlations, pairs, and outcomes in units of their published ranges."""
    from analysis.figures.style import COLOURS, blank, grid, save, ticks

    canvas = blank(13.0, 11.0)
    (left, right), (below, last) = grid(canvas, 2, 2)
    names = [*PRIOR]
    ranked = prior[[*names, *ALL]].corr(method="spearman").loc[list(ALL), names].to_numpy()
    _map(
        left,
        np.abs(ranked),
        [f"{x:.1f}" for x in ranked.round(1).ravel() + 0.0],
        names,
        "Blues",
        1.0,
    )
    left.set_title("Rank correlation of parameter and outcome in the prior")
    texts = [
        str(c) if c else ("0" if j > 0.0 else "0*")
        for c, j in zip(counts.to_numpy().ravel(), joint.to_numpy().ravel(), strict=True)
    ]
    _map(right, np.log1p(counts.to_numpy()), texts, list(ALL), "Greens", np.log1p(len(prior)))
    right.set_title(f"Sets of {len(prior)} that meet both (0*: a search found one)")
    near = nearest_sets(prior)
    marks = (("planes", "s", COLOURS[5]), ("curve", "o", COLOURS[4]))
    for k, (low, high) in enumerate(WANTED.values()):
        name, middle, half = ALL[k], 0.5 * (low + high), 0.5 * (high - low)
        below.barh(k, 2.0 * half / middle, left=-half / middle, height=0.9, color="0.85")
        for sets, y, colour in ((prior, 0.2, "0.4"), (near, -0.2, COLOURS[4])):
            ends = np.nanquantile(sets[name], [0.05, 0.95]) / middle - 1.0
            below.plot(ends, [k + y] * 2, color=colour, lw=3.0)
        for path, mark, colour in marks:
            x = found[f"all, {path}"].outcomes[name] / middle - 1.0
            below.plot(x, k, mark, color=colour, mec="black", ms=6)
    below.set_xlim(-1.0, 1.5)
    ticks(below, "y", range(len(ALL)), ALL)
    below.set_xlabel("relative difference from the middle of the published range (grey)")
    below.set_title("Outcomes: prior (grey), posterior (blue), 90 %; nearest sets")
    for k, (name, (low, high)) in enumerate(PRIOR.items()):
        ends = (np.nanquantile(near[name], [0.05, 0.5, 0.95]) - low) / (high - low)
        last.plot(ends[[0, 2]], [k, k], color=COLOURS[4], lw=3.0)
        last.plot(ends[1], k, "|", color="black", ms=12)
        for path, mark, colour in marks:
            x = (found[f"all, {path}"].own[name] - low) / (high - low)
            last.plot(x, k, mark, color=colour, mec="black", ms=6)
    last.set_xlim(-0.02, 1.02)
    ticks(last, "y", range(len(names)), names)
    last.set_xlabel("share of the prior range")
    last.set_title("Parameters: posterior (90 %, median) and nearest sets")
    canvas.suptitle("Unstated parameters and outcomes of the published jaw (simulated)")
    save(canvas, out / "jaw_posterior.png", dpi=90)


def _map(
    panel, values: np.ndarray, texts: Sequence[str], columns: list[str], shades: str, most: float
) -> None:  # pyright: ignore
    """Draw a matrix of outcomes over columns with a text in every cell."""
    from analysis.figures.style import ticks

    panel.imshow(values, cmap=shades, vmin=0.0, vmax=most, aspect="auto")
    for k, text in enumerate(texts):
        row, column = divmod(k, len(columns))
        dark = values[row, column] > 0.6 * most
        panel.text(
            column,
            row,
            text,
            ha="center",
            va="center",
            fontsize=7,
            color="white" if dark else "black",
        )
    ticks(panel, "y", range(len(ALL)), ALL)
    ticks(panel, "x", range(len(columns)), columns)
    panel.tick_params(axis="x", rotation=60)
