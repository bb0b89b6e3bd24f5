"""Calibration of tests with few volunteers and instructions, and their results for the studies."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import t

from analysis.axes import reference_cube
from analysis.figures.style import COLOURS, MARKS, blank, grid, heading, legend, save, styled, ticks
from analysis.statistics.mixed_model import fit_differences
from analysis.statistics.scope import LEAST_INSTRUCTIONS, LEAST_VOLUNTEERS
from analysis.statistics.simulated import simulated_scores
from analysis.statistics.summary import conclusions, statistics_table, study_statistics
from analysis.tables import Column, Table
from studies.science.setup import each

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SPREADS = (0.0, 0.15, 0.3)  #: standard deviations of instruction x strategy in Fisher's z
SHOWN_AT = 0.3  #: standard deviation at which the text states size and coverage
CUBES = 200
SEED = 4000
MODELS = {
    "without": "no term for instruction x strategy",
    "these instructions": "these instructions (fixed)",
    "instructions": "instructions in general (random)",
}
"""Models compared by their claims about instructions in general."""


def make(studies: Mapping[str, Path], out: Path) -> str:
    """Write size and coverage against the spread of instructions, and the contrasts of each study."""
    worth = claims_in_general()
    save(claims_figure(worth), out / "inference.svg")
    (out / "inference.csv").write_text(claims_table(worth).csv(), encoding="utf-8")
    lines = [
        "## Scope of inference",
        "",
        claims_sentences(claims_table(worth)),
        "",
        "![Size and coverage of claims about instructions in general against the standard deviation of "
        "instruction x strategy, simulated scores](inference.svg)",
        "",
        "The next table lists the contrasts of the studies on this page in both scopes (mixed model; "
        f"no interval is given with fewer than {LEAST_VOLUNTEERS} volunteers or, for instructions in "
        f"general, with fewer than {LEAST_INSTRUCTIONS} instructions):",
        "",
    ]
    cubes = {world: _cube(folder) for world, folder in studies.items()}
    tests = {world: study_statistics(cube) for world, cube in cubes.items()}
    table = contrasts_table(tests)
    (out / "contrasts.csv").write_text(table.csv(), encoding="utf-8")
    save(contrasts_figure(table), out / "contrasts.svg")
    lines += [table.markdown(), "![Contrasts of the strategies in both scopes](contrasts.svg)", ""]
    for world, tested in tests.items():
        text = statistics_table(tested).csv()
        (out / f"tests_{world}.csv").write_text(text, encoding="utf-8")
        lines += [f"Conclusions for the {world} world (simulated):", ""]
        lines += [f"* {sentence}" for sentence in conclusions(tested)] + [""]
    return "\n".join(lines)


def claims_sentences(table: Table) -> str:
    """Describe the size and coverage of `claims_table` at one spread of instructions."""
    rows = {(row[0], row[1]): row for row in table.rows}
    bad, good = (rows[SHOWN_AT, MODELS[model]] for model in ("without", "instructions"))
    false, covered, fewer, more = (
        f"{100 * float(str(value)):.0f} %" for value in (*bad[2:4], *good[2:4])
    )
    return (
        f"Each point of the figure was computed from {CUBES} cubes of simulated scores of six "
        "volunteers and six instructions, without a difference between strategies. If the effect of "
        f"the strategy varies among instructions with a standard deviation of {SHOWN_AT:g} in z, a "
        "model without a term for instruction x strategy makes a false claim about instructions in "
        f"general in {false} of the cubes (nominal 5 %), and its intervals contain the true value in "
        f"{covered} of the cubes. For a model with this term, the values are {fewer} and {more}, and "
        "the intervals are wider. A test that treats the instructions as fixed is valid only for these "
        "instructions."
    )


def claims_in_general() -> xr.Dataset:
    """Size at 0.05 and coverage of 0.95 [1] of three models for instructions in general."""
    drawn = each(_of_one_cube, [(spread, k) for spread in SPREADS for k in range(CUBES)])
    outside = np.array(drawn).reshape(len(SPREADS), CUBES, len(MODELS)).swapaxes(1, 2)
    share = outside.mean(axis=2)
    error = np.sqrt(share * (1.0 - share) / CUBES)
    dims = ("spread", "model")
    return xr.Dataset(
        {"size": (dims, share), "coverage": (dims, 1.0 - share), "error": (dims, error)},
        coords={"spread": list(SPREADS), "model": list(MODELS)},
    )


def _of_one_cube(job: tuple[float, int]) -> list[bool]:
    """Test if the interval of each model excludes 0, in one cube of simulated scores."""
    spread, index = job
    cube = simulated_scores(
        SEED + index, instructions=6, repetitions=1, sd_instruction_strategy=spread
    )
    rho = cube["rho"].transpose("volunteer", "instruction", "strategy", ...).values
    return _outside(np.arctanh(rho[..., 0, :]))


def _outside(z: NDArray[np.float64]) -> list[bool]:
    """Test if the interval of each model excludes 0; z (volunteer, instruction, strategy, marker)."""
    estimate, error, freedom = without_the_term(z)
    excluded = [abs(estimate) > float(t.ppf(0.975, freedom)) * error]
    differences = (z[:, :, 1] - z[:, :, 0]).mean(axis=2)
    for scope in ("these instructions", "instructions"):
        fitted = fit_differences(differences, scope)
        if isinstance(fitted, str):
            raise RuntimeError(fitted)
        reach = float(t.ppf(0.975, fitted.freedom)) * fitted.error
        excluded.append(abs(fitted.estimate) > reach)
    return excluded


def without_the_term(z: NDArray[np.float64]) -> tuple[float, float, int]:
    """Fit the second minus the first strategy without instruction x strategy, on complete data.

    z = strategy + volunteer + instruction + marker + volunteer x strategy + residual; restricted
    maximum likelihood in closed form, volunteer x strategy at least zero. Returns the estimate, its
    standard error and the degrees of freedom, (volunteers - 1)(strategies - 1).
    """
    v, i, s, m = z.shape
    cell = z.mean(axis=(1, 3))
    rest = cell - cell.mean(axis=0) - cell.mean(axis=1)[:, None] + z.mean()
    freedom = (v - 1) * (s - 1)
    interaction = i * m * float((rest**2).sum())
    additive = cell[:, None, :, None]
    for axes in ((0, 2, 3), (0, 1, 2)):
        additive = additive + z.mean(axis=axes, keepdims=True) - z.mean()
    residual = float(((z - additive) ** 2).sum())
    free = z.size - v * s - (i - 1) - (m - 1)
    square = interaction / freedom
    if square < residual / free:
        square = (interaction + residual) / (freedom + free)
    estimate = float(cell[:, 1].mean() - cell[:, 0].mean())
    return estimate, math.sqrt(2.0 * square / (v * i * m)), freedom


@styled
def claims_figure(worth: xr.Dataset) -> "Figure":
    """Draw size and coverage against the spread, one line per model, with Monte Carlo errors."""
    figure = blank(7.5, 3.2)
    panels = grid(figure, 1, 2)[0]
    handles = []
    for panel, name, nominal in zip(panels, ("size", "coverage"), (0.05, 0.95), strict=True):
        panel.axhline(nominal, color="0.5", linewidth=0.8, zorder=0)
        drawn = []
        for k, model in enumerate(MODELS):
            one = worth.sel(model=model)
            line = panel.errorbar(
                one["spread"].values, one[name].values, 2.0 * one["error"].values,
                marker=MARKS[k], color=COLOURS[(4, 1, 2)[k]], capsize=2.0, label=MODELS[model],
            )  # fmt: skip
            drawn.append(line)
        handles = drawn
        panel.set_xlabel("standard deviation of instruction x strategy [z]")
        panel.set_ylabel(f"{name}, nominal {nominal:g}")
    panels[0].set_ylim(0.0, None)
    panels[1].set_ylim(None, 1.0)
    legend(figure, handles, most=3)
    heading(figure, "claims about instructions in general, six volunteers", "simulated")
    return figure


def claims_table(worth: xr.Dataset) -> Table:
    """List size and coverage with their Monte Carlo error."""
    rows = [
        (float(spread), MODELS[str(model)])
        + tuple(
            float(worth[n].sel(spread=spread, model=model)) for n in ("size", "coverage", "error")
        )
        for spread in worth["spread"].values
        for model in worth["model"].values
    ]
    heads = ("spread", "model", "size", "coverage", "Monte Carlo error")
    title = "claims about instructions in general, simulated scores"
    return Table(title, tuple(map(Column, heads)), tuple(rows), "simulated")


def contrasts_table(tests: Mapping[str, Mapping[str, xr.Dataset]]) -> Table:
    """List the contrasts of every study by the mixed model, in both scopes."""
    rows: list[tuple[object, ...]] = []
    origin = "simulated"
    for world, tested in tests.items():
        for name in ("mixed_model_these_instructions", "mixed_model"):
            each = tested[name]
            scope = "in general" if name == "mixed_model" else "these"
            for k, contrast in enumerate(each["contrast"].values):
                one = each.isel(contrast=k)
                low, high = (float(bound) for bound in one["interval"].values)
                rows.append(
                    (world, str(contrast), scope, float(one["estimate"]), low, high,
                     float(one["p"]), float(one["p_holm"]), int(one["n"]))
                )  # fmt: skip
    columns = (
        *map(Column, ("world", "contrast", "instructions", "difference", "lower", "upper")),
        Column("p", digits=3), Column("p Holm", digits=3), Column("volunteers"),
    )  # fmt: skip
    title = "difference of strategies in Fisher's z, simulated recordings"
    note = (
        "Each interval of 0.95 refers to one contrast; p Holm is corrected over the contrasts of one "
        "test."
    )
    return Table(title, columns, tuple(rows), origin, note)


@styled
def contrasts_figure(table: Table) -> "Figure":
    """Draw every contrast with its interval in both scopes, one block per world."""
    figure = blank(7.5, 1.2 + 0.28 * len(table.rows))
    panel = grid(figure)[0][0]
    panel.axvline(0.0, color="0.5", linewidth=0.8, zorder=0)
    heads = list(dict.fromkeys((str(row[0]), str(row[1])) for row in table.rows))
    handles = {}
    for world, contrast, scope, estimate, low, high, *_ in table.rows:
        k = 0 if scope == "these" else 1
        place = heads.index((str(world), str(contrast))) + (0.15, -0.15)[k] * -1.0
        colour = COLOURS[(1, 2)[k]]
        if math.isfinite(low):
            panel.plot([low, high], [place, place], color=colour, linewidth=1.4)
        (handles[scope],) = panel.plot(
            [estimate], [place], MARKS[1 + k], color=colour, label=f"instructions: {scope}"
        )
    ticks(
        panel, "y", list(range(len(heads))), [f"{world}: {contrast}" for world, contrast in heads]
    )
    panel.set_ylim(len(heads) - 0.5, -0.5)
    panel.set_xlabel("difference of rho [Fisher z]")
    legend(figure, list(handles.values()))
    heading(figure, "strategies compared", "simulated")
    return figure


def _cube(folder: Path) -> xr.Dataset:
    with xr.open_dataset(folder / "cube.nc") as cube:
        return reference_cube(cube.load())
