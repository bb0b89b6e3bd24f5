"""Parameters of a law from curves of a probe: least squares, intervals, and what is not identified.

With residuals r_k = (model - measured) / noise, the logarithms x of the parameters minimise sum r^2
(scipy, trust region). J = dr/dx gives the covariance s^2 (J'J)^-1, s^2 = sum r^2 / (n - p) if the noise
is not known, and the intervals x +- t sd. A parameter is not identified if its interval spans more than
a factor `SPAN`, or it ends at a bound. Small singular values of J name combinations of parameters that
the curves do not determine, such as c10 c20^a kappa^b.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd
from scipy.optimize import least_squares
from scipy.stats import t as student

from emgface.errors import FitError, listed
from emgface.fit.probing import PROBE_DIRECTIONS
from emgface.fit.triangulated import Floats

SPAN: Final = 4.0  #: ratio of the bounds of an interval beyond which a parameter is not identified
MATERIAL_PROBABILITY: Final = 0.9
BOUND: Final = 1e3  #: factor by which a parameter may differ from its start
LOGARITHM_STEP: Final = 1e-3  #: step of the logarithms for derivatives [1]
NRMSE: Final = 0.12  #: largest misfit that is accepted; the best published is 12 % [1]

Model = Callable[[Mapping[str, float]], Mapping[str, Floats]]


@dataclass(frozen=True, eq=False)
class Curve:
    """Displacements (n,) [m] of a probe and its forces (n,) [N]."""

    displacement: Floats
    force: Floats


@dataclass(frozen=True)
class FittedMaterial:
    """Parameters with their intervals, and what the curves do not determine."""

    parameters: pd.DataFrame  #: value, lower, upper, identified, by name
    correlation: pd.DataFrame  #: of the logarithms of the parameters
    condition: float  #: ratio of the largest and the smallest singular value of J
    weakest: Mapping[str, float]  #: exponents of the combination that is determined least
    weakest_spread: float  #: standard deviation of the logarithm of this combination
    nrmse: float  #: rms misfit over the rms force [1]
    statement: str  #: sentence on identifiability

    def __getitem__(self, name: str) -> float:
        """Value of a parameter."""
        return float(np.asarray(self.parameters.loc[name, "value"]))


def probe_curves_of(table: pd.DataFrame) -> dict[str, Curve]:
    """Curves of a table with the columns direction, displacement_mm, force_mn; FitError if unusable."""
    wanted = ("direction", "displacement_mm", "force_mn")
    if absent := [name for name in wanted if name not in table]:
        raise FitError(
            f"the table has no column {listed(absent)}, expected {listed(wanted)}: rename its columns"
        )
    curves: dict[str, Curve] = {}
    for direction, rows in table.groupby("direction", sort=False):
        curves[str(direction)] = Curve(
            1e-3 * pd.to_numeric(rows["displacement_mm"], errors="coerce").to_numpy(dtype=float),
            1e-3 * pd.to_numeric(rows["force_mn"], errors="coerce").to_numpy(dtype=float),
        )
    return _checked(curves)


def fit_material(
    model: Model,
    start: Mapping[str, float],
    curves: Mapping[str, Curve],
    *,
    noise: float | None = None,
    level: float = MATERIAL_PROBABILITY,
) -> FittedMaterial:
    """Fit positive parameters of a model to curves.

    `model` returns forces [N] at the displacements of the curves, by direction, for parameters by
    name, such as `emgface.fit.probing.probe_forces`. `noise` is the standard deviation of a force [N];
    without it, the misfit determines it. Raises FitError for unusable curves, fewer forces than
    parameters, or a misfit above `NRMSE`.
    """
    curves, names = _checked(curves), list(start)
    if bad := [name for name, value in start.items() if not (np.isfinite(value) and value > 0.0)]:
        raise FitError(f"the start of {listed(bad)} is not positive, expected positive parameters")
    measured = np.concatenate([curve.force for curve in curves.values()])
    if len(measured) <= len(names):
        raise FitError(
            f"{len(measured)} forces are given for {len(names)} parameters, expected more: add points "
            "or fix parameters"
        )
    size = float(np.sqrt(np.mean(measured**2)))
    unit = noise or 0.01 * size
    x0 = np.log([start[name] for name in names])

    def residual(x: Floats) -> Floats:
        forces = model(dict(zip(names, np.exp(x).tolist(), strict=True)))
        return (np.concatenate([forces[name] for name in curves]) - measured) / unit

    steps = [LOGARITHM_STEP] * len(names)
    done: Any = least_squares(
        residual, x0, bounds=(x0 - np.log(BOUND), x0 + np.log(BOUND)), diff_step=steps, x_scale=1.0,
        xtol=1e-6, ftol=1e-8, max_nfev=60,
    )  # fmt: skip
    misfit = float(np.sqrt(np.mean(done.fun**2))) * unit / size
    if not (done.status > 0 and misfit <= NRMSE):
        raise FitError(
            f"the curves are fitted to {misfit:.1%} of the rms force only ({done.message}), expected at "
            f"most {NRMSE:.0%}: check units and geometry, or choose another law or start"
        )
    return _statistics(done, names, len(measured), noise, level, misfit)


def _statistics(
    done: Any, names: Sequence[str], count: int, noise: float | None, level: float, misfit: float
) -> FittedMaterial:
    freedom = count - len(names)
    variance = 1.0 if noise is not None else float((done.fun**2).sum()) / freedom
    _, s, Vt = np.linalg.svd(done.jac, full_matrices=False)
    s = np.maximum(s, 1e-12 * s[0])
    C = variance * (Vt.T / s**2) @ Vt
    sd = np.sqrt(np.diag(C))
    quantile = float(student.ppf(0.5 + 0.5 * level, freedom if noise is None else 1e9))
    with np.errstate(over="ignore"):
        low, high = np.exp(done.x - quantile * sd), np.exp(done.x + quantile * sd)
    known = (2.0 * quantile * sd < np.log(SPAN)) & (np.asarray(done.active_mask) == 0)
    table = pd.DataFrame(
        {"value": np.exp(done.x), "lower": low, "upper": high, "identified": known},
        index=list(names),
    )
    weakest = Vt[-1] / np.abs(Vt[-1]).max()
    spread = float(np.sqrt(variance)) / float(s[-1])
    exponents = dict(zip(names, weakest.round(2).tolist(), strict=True))
    return FittedMaterial(
        table, pd.DataFrame(C / np.outer(sd, sd), index=list(names), columns=list(names)),
        float(s[0] / s[-1]), exponents, spread, misfit, _statement(table, exponents, spread),
    )  # fmt: skip


def _statement(table: pd.DataFrame, weakest: Mapping[str, float], spread: float) -> str:
    unknown = [str(name) for name in table.index[~table["identified"]]]
    if not unknown:
        return f"All parameters are identified: their intervals span less than a factor {SPAN:g}."
    product = " ".join(f"{name}^{power:g}" for name, power in weakest.items() if abs(power) > 0.05)
    return (
        f"The curves do not identify {', '.join(unknown)}: the interval spans a factor {SPAN:g} or "
        f"more. The combination {product} is determined least (its logarithm to {spread:.2g}); "
        "probe further directions, or fix a parameter by the literature."
    )


def _checked(curves: Mapping[str, Curve]) -> dict[str, Curve]:
    if not curves:
        raise FitError("no curve is given, expected at least one")
    for name, curve in curves.items():
        if name not in PROBE_DIRECTIONS:
            raise FitError(
                f"there is no direction {name!r}, expected some of {', '.join(PROBE_DIRECTIONS)}"
            )
        d, f = np.asarray(curve.displacement), np.asarray(curve.force)
        if d.shape != f.shape or d.ndim != 1 or len(d) < 2:
            raise FitError(
                f"the curve {name} has shapes {d.shape} and {f.shape}, expected equal numbers of at "
                "least two displacements and forces"
            )
        if not (np.isfinite(d).all() and np.isfinite(f).all()):
            raise FitError(f"the curve {name} has values that are not finite, expected numbers")
        if not (np.diff(d) > 0.0).all() or d[0] < 0.0 or d[-1] > 0.05:
            raise FitError(
                f"the displacements of {name} are {1e3 * d[0]:.3g} to {1e3 * d[-1]:.3g} mm, expected "
                "increasing ones from 0 to at most 50 mm: use the loading branch, and check the unit"
            )
        if not f[-1] > 0.0:
            raise FitError(
                f"the last force of {name} is {f[-1]:.3g} N, expected a positive one along the "
                "direction of the probe: check the sign"
            )
    return dict(curves)
