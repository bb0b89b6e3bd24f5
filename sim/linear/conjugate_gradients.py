"""Truncated preconditioned conjugate gradients for Newton's method."""

import numpy as np

from sim.linear.contract import Operator
from sim.state import Array
from sim.vectors import dot


def conjugate_gradients(
    product: Operator, precondition: Operator, rhs: Array, share: float, limit: int
) -> Array:
    """Approximate solution x of A x = b from x = 0.

    Ended early it still has b'x > 0: with b the negative gradient, x is a direction of descent. That
    needs a symmetric positive definite preconditioner P, and of A only that no direction of negative
    curvature is met; the iteration ends where one is.

    Parameters
    ----------
    product, precondition : callable
        x -> A x and r -> P^-1 r.
    rhs : (n,)
    share : float
        It ends when the largest component of x changes by no more than this share.
    limit : int
        Solutions with P at most.

    Notes
    -----
    Source: Steihaug 1983, SIAM J. Numer. Anal. 20, p. 626.
    """
    x, r = np.zeros(len(rhs)), rhs
    p, before = np.zeros(len(rhs)), 1.0
    for k in range(limit):
        z = precondition(r)
        now = dot(r, z)
        p = z + (now / before if k else 0.0) * p
        Ap = product(p)
        bent = dot(p, Ap)
        if not bent > 0.0:
            return p if k == 0 else x
        length = now / bent
        x = x + length * p
        if length * float(np.abs(p).max()) <= share * float(np.abs(x).max()):
            break
        r = r - length * Ap
        before = now
    return x
