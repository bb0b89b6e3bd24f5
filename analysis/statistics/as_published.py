"""Analyses of variance and mixed models as papers print them, by statsmodels.

Which implementation computes what, and why:

* Analyses of variance and the mixed model printed here are those of statsmodels; the chi-square, normal
  and t distributions, ranks and tests of normality are those of scipy.
* Holm's correction is computed here (`finding`) to the same bits as by statsmodels, whose function
  collects the garbage of the whole process in every call: 0.2 s in a small process, seconds in a large
  one.
* The Wilcoxon and Friedman tests are enumerated here (`ranks`): scipy enumerates no ties or zeros, and
  Friedman's p only by the chi-square limit, which is wrong for six volunteers.
* The sign-flip test and its interval are computed here (`sign_flip`): `scipy.stats.permutation_test` has
  the same p, but neither the interval nor the joint adjustment over contrasts.
* The bootstrap over volunteers and, within them, trials is computed here (`bootstrap`), because
  `scipy.stats.bootstrap` draws one level.
* The mixed model of `mixed_model` is fitted here (`crossed`): `MixedLM` fails or warns if a variance is
  zero, as it is in most studies of few volunteers, and has no degrees of freedom of Satterthwaite.
  `cross_check` prints the fit of `MixedLM` where it converges.
"""

import math
import warnings
from importlib import import_module
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from analysis.errors import StatisticsError
from analysis.statistics.finding import holm
from analysis.statistics.mixed_model import cell_means
from analysis.statistics.paired import LIMIT, Comparison, Scale, on_scale

FACTORS = ("strategy", "instruction")
LEAST_ANOVA_VOLUNTEERS = 2  #: volunteers of an analysis of variance


def repeated_measures(
    cube: xr.Dataset, *, variable: str = "rho", scale: Scale = "z", limit: float = LIMIT
) -> pd.DataFrame:
    """Analysis of variance of a variable with the repeated factors strategy and instruction.

    Values that all strategies have are averaged over repetitions and markers; volunteers with a
    missing cell are left out. The table has the effects as rows, and the columns ``F``, ``df``,
    ``df_error``, ``p``, ``p_holm`` (over the effects) and ``volunteers``. Sphericity is assumed, as in
    printed analyses, and the instructions are those of the study. Raises StatisticsError for fewer
    than two complete volunteers, or no factor with two levels.
    """
    AnovaRM: Any = import_module("statsmodels.stats.anova").AnovaRM

    data = on_scale(cube, variable, scale, limit)
    # A marker that one strategy lacks would otherwise change the mean of that strategy alone.
    data = data.where(data.notnull().all("strategy")).mean(["repetition", "marker"])
    whole = data.notnull().all([dim for dim in data.dims if dim != "volunteer"])
    data = data.isel(volunteer=np.flatnonzero(whole.values))
    factors = [name for name in FACTORS if data.sizes[name] > 1]
    if data.sizes["volunteer"] < LEAST_ANOVA_VOLUNTEERS or not factors:
        raise StatisticsError(
            f"{data.sizes['volunteer']} volunteers have all strategies and instructions, and "
            f"{len(factors)} factors have two levels; expected {LEAST_ANOVA_VOLUNTEERS} volunteers "
            "and one factor"
        )
    rows = data.rename("y").to_dataframe().reset_index()
    table = AnovaRM(rows, "y", "volunteer", within=factors).fit().anova_table
    p = np.asarray(table["Pr > F"], dtype=np.float64)
    return pd.DataFrame(
        {
            "F": table["F Value"].to_numpy(),
            "df": table["Num DF"].to_numpy(),
            "df_error": table["Den DF"].to_numpy(),
            "p": p,
            "p_holm": holm(p),
            "volunteers": data.sizes["volunteer"],
        },
        index=pd.Index([str(name) for name in table.index], name="effect"),
    )


def cross_check(data: Comparison) -> pd.DataFrame:
    """Fit of the crossed mixed model of every contrast by `MixedLM`, NaN where it does not converge.

    The model is that of `mixed_model` with the scope "instructions". Columns are ``estimate``,
    ``standard_error``, the variances ``volunteer``, ``instruction`` and ``residual``, and ``converged``.
    """
    models: Any = import_module("statsmodels.regression.mixed_linear_model")

    random = ("volunteer", "instruction")
    fits: dict[str, dict[str, float | bool]] = {}
    for each in data.pairs:
        table = cell_means(each)
        places = np.nonzero(np.isfinite(table))
        y = table[places]
        row: dict[str, float | bool] = dict.fromkeys(
            ("estimate", "standard_error", *random, "residual"), math.nan
        )
        designs = [(at[:, None] == np.unique(at)).astype(np.float64) for at in places]
        names = [[[str(k) for k in range(d.shape[1])]] for d in designs]
        spec = models.VCSpec(list(random), names, [[d] for d in designs])
        one, fit, converged = np.ones(len(y)), None, False
        with warnings.catch_warnings():  # of variances that are zero
            warnings.simplefilter("ignore")
            try:
                fit = models.MixedLM(y, one[:, None], groups=one, exog_vc=spec).fit(
                    method="powell", ftol=1e-12
                )
                converged = bool(fit.converged)
            except (np.linalg.LinAlgError, ValueError):
                pass
        if fit is not None and converged:
            row |= dict(zip(random, map(float, fit.vcomp), strict=True)) | {
                "estimate": float(fit.fe_params[0]),
                "standard_error": float(fit.bse_fe[0]),
                "residual": float(fit.scale),
            }
        fits[each.label] = row | {"converged": converged}
    return pd.DataFrame.from_dict(fits, orient="index").rename_axis("contrast")


__all__ = ["cross_check", "repeated_measures"]
