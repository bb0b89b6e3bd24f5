"""Objective of inverse tracking: misfit of the targets, sEMG, size and change of the activations."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from sim.activation import Activation
from sim.checks import real_numbers
from sim.errors import ControlError, SceneError
from sim.inverse.response import Form
from sim.state import Array

Aim = Literal["position", "velocity"]
REDONE = 3  #: largest number of linearisations of a step


@dataclass(frozen=True)
@real_numbers
class Weights:
    """Terms of the objective of a step, all dimensionless, and the bounds of the activations.

    The objective is motion/2 |r|^2 + size/2 |a|^2 + change/2 |a - a_before|^2 + the sEMG term of
    `MeasuredActivation`, where r are the residuals over the sizes of their targets.
    """

    #: weights [1]
    motion: float = 1.0
    size: float = 1e-4
    change: float = 1e-4
    #: bounds of the activations, within 0-1
    low: float | Array = 0.0
    high: float | Array = 1.0
    jump: float = 1.0  #: largest change of an activation in one step
    #: time T in which a deviation is to vanish [s], at least the step; default: the step
    chase: float | None = None
    #: the end of the step should be at x + h (x_t' + (x_t - x)/T) with the mean velocity x_t' of the
    #: target, so that T = h reaches the target without overshoot; or have the velocity
    #: x_t' + (x_t - x)/T with x_t at the end of the step, the rule of the published controller,
    #: which moves x by h x_t' too far in each step if T = h
    aim: Aim = "position"
    #: divide the residuals by the Frobenius norm of their derivatives, as the published controller
    #: does. The meaning of the weights then changes from step to step
    normalise: bool = False
    #: derivatives of `step_response`, at the activation of the step before; or, as published, with the
    #: matrix of the step at activation 0
    form: Form = "exact"
    #: linearisations of each step, at most three. With one and the exact form, the linearised step is
    #: the step; otherwise, and with joints or contact, the step is computed again with its activation
    rounds: int = 1

    def __post_init__(self) -> None:
        low, high = np.asarray(self.low), np.asarray(self.high)
        if not (np.all(low >= 0.0) and np.all(high <= 1.0) and np.all(low <= high)):
            raise ControlError("bounds of the activations must satisfy 0 <= low <= high <= 1")
        values = (self.motion, self.size, self.change)
        if not (np.isfinite(values).all() and min(values) >= 0.0 and self.jump > 0.0):
            raise SceneError(
                f"weights {values} and jump {self.jump}: expected numbers >= 0, jump > 0"
            )
        if not 1 <= self.rounds <= REDONE:
            raise SceneError(f"rounds = {self.rounds}, expected 1 to {REDONE}")


@dataclass(frozen=True, eq=False)
@real_numbers
class MeasuredActivation:
    """Activation estimated from sEMG, and the trust in each muscle."""

    activation: Activation  #: of all muscles; values of muscles without trust are ignored
    #: (n_muscles,) weight w_e/2 trust (a - a_emg)^2 of each muscle [1], 0 if it is not measured,
    #: infinite if its activation is prescribed
    trust: Array = field(default_factory=lambda: np.zeros(0))
    #: (n_muscles, n_muscles) share of every muscle (column) in every measured activation (row) by
    #: cross-talk; by default the identity
    mixing: Array | None = None

    def __post_init__(self) -> None:
        n = self.activation.values.shape[1]
        if self.mixing is not None and np.isinf(self.trust).any():
            raise ControlError(
                "a muscle is prescribed by an activation with cross-talk: leave the mixing matrix out, "
                "or use a finite trust"
            )
        if self.trust.shape != (n,) or not (self.trust >= 0.0).all():
            raise ControlError(
                f"trust of shape {self.trust.shape} for {n} muscles, expected one number >= 0 for each"
            )


@dataclass(frozen=True, eq=False)
class Objective:
    """Objective at one time, with the bounds of the activations.

    J(a) = motion/2 |r(a)|^2 + size/2 |a|^2 + change/2 |a - last|^2 + sum trust/2 (mixing a - given)^2
    """

    weights: Weights
    last: Array  #: (n,) activations of the time before
    given: Array  #: (n,) activations from sEMG
    soft: Array  #: (n,) finite trust in them
    mixing: Array  #: (n, n)
    low: Array  #: (n,)
    high: Array  #: (n,)

    @classmethod
    def at(
        cls, t: float, last: Array, weights: Weights, measured: MeasuredActivation | None
    ) -> "Objective":
        """Objective at a time [s]; muscles whose activation is prescribed have equal bounds."""
        n = len(last)
        given, soft, fixed, mixing = np.zeros(n), np.zeros(n), np.zeros(n, dtype=bool), np.eye(n)
        if measured is not None:
            given = np.nan_to_num(np.clip(measured.activation.at(t), 0.0, 1.0))
            fixed = np.isinf(measured.trust)
            soft = np.where(fixed, 0.0, measured.trust)
            mixing = mixing if measured.mixing is None else measured.mixing
        low = np.maximum(np.broadcast_to(weights.low, n), last - weights.jump)
        high = np.minimum(np.broadcast_to(weights.high, n), last + weights.jump)
        low, high = np.where(fixed, given, low), np.where(fixed, given, high)
        return cls(weights, last, given, soft, mixing, low, np.maximum(low, high))

    def quadratic(self, along: Array, r: Array, around: Array) -> tuple[Array, Array]:
        """Matrix Q (n, n) and vector c (n,) of J = a'Qa/2 - c'a for r(a) = r - along (a - around).

        Quantities that are not measured, with r = NaN, are left out.
        """
        w, seen = self.weights, np.isfinite(r)
        along, r = along[seen], r[seen]
        norm = float(np.linalg.norm(along)) if w.normalise else 1.0
        along, r = along / max(norm, 1e-300), r / max(norm, 1e-300)
        near = (w.size + w.change) * np.eye(len(self.last))
        emg = self.mixing.T @ (self.soft[:, None] * self.mixing)
        Q = w.motion * along.T @ along + emg + near
        c = w.motion * along.T @ (r + along @ around)
        return Q, c + w.change * self.last + self.mixing.T @ (self.soft * self.given)

    def value(self, r: Array, a: Array) -> float:
        """J of activations a (n,) with the residuals r, of which NaN are left out."""
        w = self.weights
        emg = self.soft @ (self.mixing @ a - self.given) ** 2
        change = w.change * ((a - self.last) ** 2).sum()
        return 0.5 * float(w.motion * np.nansum(r**2) + w.size * (a**2).sum() + change + emg)
