"""Truncated preconditioned conjugate gradients for Newton's method."""

import numpy as np

from sim.linear.contract import Operator
from sim.state import Array
from sim.vectors import dot


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
