"""Typed failures of the mechanics.

Each message is one sentence: what was found, what was expected, what to try.
"""

SWING_LOST = 0.1
"""Share of the energy of turning tissue whose loss is warned of."""


class SimulationError(Exception):
    """Base class of the errors of the mechanics."""


class MeshError(SimulationError, ValueError):
    """A mesh is unusable at rest: inverted element, node out of range, unused node."""


class ControlError(SimulationError, ValueError):
    """An activation is not finite, lies outside 0-1 or has the wrong length."""


class SceneError(SimulationError, ValueError):
    """Parts of a scene do not fit together."""


class InvertedElement(SimulationError):
    """A Gauss point of an element has det F <= 0.

    Attributes
    ----------
    element : int
        Index of the element in its block order (the mesh's element numbering).
    det_F : float
        Determinant found there.
    time : float
        Simulated time in seconds.
    """

    def __init__(self, element: int, det_F: float, time: float) -> None:
        self.element, self.det_F, self.time = element, det_F, time
        super().__init__(
            f"element {element} inverted at t = {time:.4g} s (det F = {det_F:.3g}, expected > 0): "
            "try a smaller step, a lower sigma_max, or the converged solver"
        )


class NotConverged(SimulationError):
    """A step ended without meeting its tolerances.

    Attributes
    ----------
    residuals : tuple of float
        Residual norm in newtons at every iteration.
    time : float
        Simulated time in seconds.
    """

    def __init__(self, residuals: tuple[float, ...], time: float, why: str) -> None:
        self.residuals, self.time = residuals, time
        last = f"{residuals[-1]:.3g} N" if residuals else "unknown"
        super().__init__(
            f"the step to t = {time:.4g} s did not converge ({why}; residual {last} after "
            f"{len(residuals)} iterations): try a smaller step or a lower activation"
        )


class ToleranceMissed(SimulationError):
    """The steps of an error control do not reach the requested accuracy.

    A step converged and inverted no element, but its error is too large, and shorter steps are not
    allowed or do not converge. This does not concern the strength of the muscles.

    Attributes
    ----------
    error, allowed : float
        Estimated and largest allowed error of the step [m].
    time : float
        Simulated time in seconds.
    """

    def __init__(self, error: float, allowed: float, h: float, time: float) -> None:
        self.error, self.allowed, self.time = error, allowed, time
        super().__init__(
            f"the smallest step that converges, {h:.2g} s to t = {time:.4g} s, errs by "
            f"{1e3 * error:.2g} mm, expected at most {1e3 * allowed:.2g} mm: request a lower accuracy, "
            "or allow more halvings"
        )


class UnstableDamping(NotConverged):
    """Damping of the current tangent feeds the motion, which grows faster than steps can follow.

    Active muscles may make the tangent indefinite; multiplied by beta it is then a negative damping.
    Shorter steps do not prevent the growth, because it is a property of the equation of motion.

    Attributes
    ----------
    rate : float
        Growth of the velocities by the power of the damping [1/s].
    time : float
        Simulated time in seconds.
    """

    def __init__(self, rate: float, time: float) -> None:
        self.rate, self.time, self.residuals = rate, time, ()
        super(NotConverged, self).__init__(
            f"the damping of the current tangent is negative at t = {time:.4g} s and multiplies the "
            f"velocities by e every {1e3 / rate:.2g} ms, expected a power <= 0: use the tangent at rest "
            "or without activation (RestRayleigh, PassiveRayleigh; damping_tangent = 'rest' or "
            "'passive'), or a lower activation"
        )


class SlowStepsWarning(UserWarning):
    """Steps of a scene of bodies use the general method, which takes about a hundred times as long."""


class LostSwingWarning(UserWarning):
    """Steps with one linear solution take the energy of tissue that turns.

    Attributes
    ----------
    share : float
        Energy that a second iteration would have given back, relative to the sum of this energy, the
        largest kinetic energy and the energy dissipated by the damping of the scene.
    time : float
        Time of the largest loss [s].
    node : int
        Node of the largest loss.
    """

    def __init__(self, share: float, time: float, node: int) -> None:
        self.share, self.time, self.node = share, time, node
        super().__init__(
            f"the steps with one linear solution take {100.0 * share:.2g} % of the energy of tissue "
            f"that turns, most at t = {time:.4g} s at node {node}, expected at most "
            f"{100.0 * SWING_LOST:g} %: the motion is too slow; choose Sdirk2 or ConvergedEuler, or a "
            "smaller step"
        )


class SingularSystem(SimulationError):
    """A matrix could not be factorised or solved."""


class ContactFailure(SimulationError):
    """A contact surface is unusable, or a contact exceeds its declared reach.

    Attributes
    ----------
    surface : str
        Name of the surface or pairing.
    triangle, node : int or None
        Place of the failure, if known.
    edge : (int, int) or None
    """

    def __init__(
        self,
        message: str,
        *,
        surface: str,
        triangle: int | None = None,
        node: int | None = None,
        edge: tuple[int, int] | None = None,
    ) -> None:
        self.surface, self.triangle, self.node, self.edge = surface, triangle, node, edge
        super().__init__(message)
