"""Conjugate gradients, and GMRES with a preconditioner."""

import math
from dataclasses import dataclass

import numpy as np

from sim.dense import dot, least, norm, reported
from sim.linear.contract import Operator
from sim.state import Array


def conjugate_gradients(
    product: Operator, precondition: Operator, rhs: Array, share: float, limit: int
) -> tuple[Array, bool]:
    """Approximate solution x of A x = b from x = 0, and True if it has converged.

    After any number of iterations b'x > 0, so that x is a descent direction if b is the negative
    gradient. The preconditioner P must be symmetric positive definite; the iteration ends at a
    direction of negative curvature of A.

    `product` and `precondition` are x -> A x and r -> P^-1 r. The iteration ends if the largest
    component of x changes by no more than a `share`, or after `limit` solutions with P.

    Source: Steihaug 1983, SIAM J. Numer. Anal. 20, p. 626.
    """
    x, r = np.zeros(len(rhs)), rhs
    p, before = np.zeros(len(rhs)), 1.0
    for k in range(limit):
        if not r.any():  # as of a single equation
            return x, True
        z = precondition(r)
        now = dot(r, z)
        p = z + (now / before if k else 0.0) * p
        Ap = product(p)
        bent = dot(p, Ap)
        if not bent > 0.0:
            return (p if k == 0 else x), False
        length = now / bent
        x = x + length * p
        if length * float(np.abs(p).max()) <= share * float(np.abs(x).max()):
            return x, True
        r = r - length * Ap
        before = now
    return x, False


PER_CYCLE = 1e-4  # Accuracy of the residual of a factor in single precision.
MAX_CYCLES = 6


@dataclass(frozen=True)
class Iterate:
    """Result of an iteration."""

    x: Array  #: (n,)
    iterations: int  #: solutions with the preconditioner
    reached: bool  #: True if the requested error was reached
    #: smallest real part of the Ritz values, estimates of the eigenvalues of P^-1 A, which are close to
    #: one if P is similar to A; infinite without iteration
    smallest: float = math.inf


def gmres(
    product: Operator, precondition: Operator, rhs: Array, start: Array, error: float, limit: int
) -> Iterate:
    """Solve A x = b by GMRES, preconditioned from the left by P^-1.

    It minimises |P^-1 (b - A x)|: with P similar to A the error of x itself, in the units of x.
    Neither A nor P need be definite.

    `product` and `precondition` are x -> A x and r -> P^-1 r; `error` is the largest remaining
    component of P^-1 (b - A x), and `limit` the largest number of solutions with P.

    Source: Saad and Schultz 1986, SIAM J. Sci. Stat. Comput. 7, p. 856; Gram and Schmidt's
    orthogonalisation is done twice (Giraud et al. 2005). The iteration restarts with the true residual
    after each reduction by 1e4.
    """
    x, spent, smallest = start, 0, math.inf
    for _ in range(MAX_CYCLES):
        if spent >= limit:
            break
        z = precondition(rhs - product(x))
        spent += 1
        size = float(np.abs(z).max())
        if not math.isfinite(size):
            break
        if size <= error:
            return Iterate(x + z, spent, True, smallest)
        goal = max(error, PER_CYCLE * size)
        change, left, more, ritz = _cycle(product, precondition, z, goal, limit - spent)
        x, spent, smallest = x + change, spent + more, min(smallest, ritz)
        if left <= error:
            return Iterate(x, spent, True, smallest)
        if left > goal:
            break
    return Iterate(x, spent, False, smallest)


def _cycle(
    product: Operator, precondition: Operator, z: Array, goal: float, limit: int
) -> tuple[Array, float, int, float]:
    """Change of x, largest component of the residual, number of solutions, smallest Ritz value."""
    basis = np.empty((limit + 1, len(z)))
    beta = norm(z)
    basis[0] = z / beta
    H = np.zeros((limit + 1, limit))
    target = np.zeros(limit + 1)
    target[0] = beta
    weights, residual = np.zeros(0), z
    for k in range(limit):
        w = precondition(product(basis[k]))
        own = basis[: k + 1]
        for _ in range(2):
            # einsum does not use a threaded BLAS, see sim.dense.
            h = np.einsum("ij,j->i", own, w)
            w = w - np.einsum("i,ij->j", h, own)
            H[: k + 1, k] += h
        H[k + 1, k] = norm(w)
        if not math.isfinite(H[k + 1, k]):
            break
        exhausted = H[k + 1, k] <= 1e-14 * beta
        if not exhausted:
            basis[k + 1] = w / H[k + 1, k]
        part = H[: k + 2, : k + 1]
        weights = least(part, target[: k + 2], "the Krylov space of a solution")
        missed = target[: k + 2] - part @ weights
        used = k + 1 if exhausted else k + 2
        residual = np.einsum("i,ij->j", missed[:used], basis[:used])
        if exhausted or float(np.abs(residual).max()) <= goal:
            break
    spent = len(weights)
    change = np.einsum("i,ij->j", weights, basis[:spent])
    # The preconditioned residual is the remaining error up to the difference of the two matrices.
    square = H[:spent, :spent]
    finite = spent > 0 and bool(np.isfinite(square).all())
    with reported("the Krylov space of a solution"):
        smallest = float(np.linalg.eigvals(square).real.min()) if finite else math.inf
    return change + residual, float(np.abs(residual).max()), spent, smallest
