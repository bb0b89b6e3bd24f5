"""Normal density of the activations within 0-1: intervals and unresolved directions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from sim.state import Array

CHAINS, DEFAULT_BURN = 64, 30  #: number of chains, and default of the sweeps before the first draw
#: number of variables after which the gradients of all others are updated
VARIABLES_PER_UPDATE = 20
#: share of the prior deviation from which a direction counts as not determined by the motion [1]
UNRESOLVED_SHARE = 0.7


@dataclass(frozen=True)
class Posterior:
    """Normal density N(mean, covariance) of the activations, restricted to the box 0-1.

    Attributes
    ----------
    mean : (n,) of the density without the box; it may lie outside of it.
    covariance : (n, n)
    """

    mean: Array
    covariance: Array

    def draws(
        self,
        n: int = 1000,
        seed: int = 0,
        burn: int = DEFAULT_BURN,
        apart: int = 1,
        centre: Array | None = None,
    ) -> Array:
        """Draws (n, n_muscles) within the box, by Gibbs sampling of `CHAINS` chains.

        Source: Geweke 1991, Efficient simulation from the multivariate normal subject to linear
        constraints.

        Parameters
        ----------
        burn, apart : int
            Sweeps before the first draw of a chain, and between its draws.
        centre : (n_muscles,), optional
            Point about which the chains begin, such as the most probable one; by default the mean. They
            begin at normal draws about it that are moved into the box, farther apart than the density.
        """
        rng = np.random.default_rng(seed)
        precision = np.asarray(np.linalg.inv(self.covariance), dtype=np.float64)
        sd = 1.0 / np.sqrt(np.diag(precision))
        spread = np.asarray(np.linalg.cholesky(self.covariance), dtype=np.float64)
        x = rng.standard_normal((CHAINS, len(sd))) @ spread.T
        x = np.clip(x + (self.mean if centre is None else centre), 0.0, 1.0)
        n_all, samples = len(sd), list[Array]()
        gradient = (x - self.mean) @ precision
        for sweep in range(burn + apart * (-(-n // CHAINS))):
            for first in range(0, n_all, VARIABLES_PER_UPDATE):
                block = slice(first, min(first + VARIABLES_PER_UPDATE, n_all))
                here, begin = gradient[:, block].copy(), x[:, block].copy()
                near = precision[block, block]
                for k, i in enumerate(range(block.start, block.stop)):
                    given = x[:, i] - here[:, k] / precision[i, i]
                    value = _truncated(given, float(sd[i]), rng.random(CHAINS))
                    here += np.outer(value - x[:, i], near[k])
                    x[:, i] = value
                gradient += (x[:, block] - begin) @ precision[block]
            if sweep >= burn and (sweep - burn) % apart == 0:
                samples.append(x.copy())
        return np.concatenate(samples)[:n]

    def intervals(self, level: float = 0.9, n: int = 1000, seed: int = 0) -> Array:
        """Central intervals (2, n_muscles) of the marginal densities within the box."""
        tails = [0.5 - 0.5 * level, 0.5 + 0.5 * level]
        return np.asarray(np.quantile(self.draws(n, seed), tails, axis=0), dtype=np.float64)

    def unresolved(self, prior_sd: Array) -> Array:
        """Directions (k, n) that keep more than `UNRESOLVED_SHARE` of their prior deviation.

        They are the eigenvectors of the posterior covariance in units of the prior deviations, the
        least determined first.
        """
        scaled = self.covariance / np.outer(prior_sd, prior_sd)
        spectrum = np.linalg.eigh(scaled)
        size = np.asarray(spectrum.eigenvalues, dtype=np.float64)
        vectors = np.asarray(spectrum.eigenvectors, dtype=np.float64)
        chosen = vectors[:, size > UNRESOLVED_SHARE**2][:, ::-1]
        return (chosen * prior_sd[:, None]).T


def _truncated(centre: Array, sd: float, u: Array) -> Array:
    """Normal draws within 0-1 from uniform ones, by the inverse of the distribution function.

    Its complement is used for means below 0, where the function itself rounds to 1.
    """
    low, high = -centre / sd, (1.0 - centre) / sd
    turned = low > 0.0
    a, b = np.where(turned, -high, low), np.where(turned, -low, high)
    below = np.asarray(ndtr(a), dtype=np.float64)
    above = np.asarray(ndtr(b), dtype=np.float64)
    z = np.asarray(ndtri(np.clip(below + (above - below) * u, 1e-300, 1.0 - 1e-16)))
    return np.clip(centre + sd * np.where(turned, -z, z), 0.0, 1.0)


def in_words(directions: Array, muscles: Sequence[str], least: float = 0.3) -> list[str]:
    """Sentences that name the muscles of unresolved directions.

    A muscle counts if its component is at least `least` of the largest. Components of opposite sign
    replace each other; those of one sign act together on nothing that is measured.
    """
    sentences: list[str] = []
    for d in directions:
        part: list[float] = (d / d[int(np.argmax(np.abs(d)))]).tolist()
        named = list(zip(part, muscles, strict=True))
        up = [muscle for share, muscle in named if share >= least]
        down = [muscle for share, muscle in named if share <= -least]
        if down:
            sentences.append(
                f"{' and '.join(up)} cannot be distinguished from {' and '.join(down)}"
            )
        elif len(up) > 1:
            sentences.append(f"the sum of {' and '.join(up)} is not determined by the motion")
        else:
            sentences.append(f"{up[0]} is not determined by the motion")
    return sentences
