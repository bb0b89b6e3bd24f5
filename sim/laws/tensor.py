"""Laws that depend on the strain tensor.

An isochoric law requires a bulk law; the others determine the change of volume themselves.
"""

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from sim._kernels import tensor_laws as kernel
from sim.checks import real_numbers, require
from sim.errors import SceneError
from sim.laws.parameters import Parametric, quantity
from sim.pattern import Array


class TensorLaw(Protocol):
    """Interface of laws of the strain tensor for the element loop."""

    code: ClassVar[int]  #: of `sim._kernels.tensor_laws.tensor_law`
    measure: ClassVar[int]  #: argument of the law: ISOCHORIC, FINITE or SMALL of the same module
    needs_axes: ClassVar[bool]  #: True if the law depends on the material axes of the element

    def parameters(self) -> tuple[float, ...]:
        """Parameters in the order of the kernel."""
        ...

    def energy(self, C: Array, axes: Array) -> float:
        """Energy W [Pa] at the strain measure C (3, 3); columns of axes (3, 3) are the material axes."""
        ...


@dataclass(frozen=True)
class FiveTermMooneyRivlin(Parametric):
    """Mooney-Rivlin law with all five terms.

    w = C10 (I1bar - 3) + C01 (I2bar - 3) + C20 (I1bar - 3)^2 + C11 (I1bar - 3)(I2bar - 3)
    + C02 (I2bar - 3)^2, with I2bar = (I1bar^2 - tr Cbar^2)/2.

    Notes
    -----
    With C01 = C11 = C02 = 0 this is `MooneyRivlin`, which is faster. Source: Stavness et al.,
    Coupled biomechanical modeling of the face, Sect. 11.2.2; the coefficients of the second
    invariant are zero there.
    """

    #: stiffnesses [Pa]; the initial shear modulus is 2 (C10 + C01), which must be positive
    C10: float = quantity(2500.0, "Pa")
    C01: float = quantity(0.0, "Pa")
    C20: float = quantity(1175.0, "Pa")
    C11: float = quantity(0.0, "Pa")
    C02: float = quantity(0.0, "Pa")
    code: ClassVar[int] = kernel.FIVE_TERM_MOONEY_RIVLIN
    measure: ClassVar[int] = kernel.ISOCHORIC
    needs_axes: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self, "C10 + C01", self.C10 + self.C01, above=0.0)

    def energy(self, C: Array, axes: Array) -> float:
        """Polynomial of both invariants of Cbar."""
        I1 = float(np.trace(C))
        x, y = I1 - 3.0, 0.5 * (I1**2 - float(np.trace(C @ C))) - 3.0
        first = self.C10 * x + self.C01 * y
        return first + self.C20 * x**2 + self.C11 * x * y + self.C02 * y**2


@dataclass(frozen=True)
@real_numbers
class Ogden(Parametric):
    """Ogden law of any number of terms in the isochoric principal stretches l_i.

    w = sum_p mu_p/alpha_p (l_1^alpha_p + l_2^alpha_p + l_3^alpha_p - 3).

    Notes
    -----
    Source: Ogden 1972, Proc R Soc A 326:565-584. The skin of the face was fitted with an Ogden law
    in vivo (Stavness et al., Sect. 11.2.2.2), but the coefficients are not stated there; the
    defaults are an example with a shear modulus of 5 kPa, that of `MooneyRivlin`.
    """

    #: coefficients [Pa]; the initial shear modulus is sum mu_p alpha_p / 2
    mu: tuple[float, ...] = quantity((1250.0, -250.0), "Pa")
    #: exponents [1], with mu_p alpha_p > 0, so that every term is stable at every stretch
    alpha: tuple[float, ...] = quantity((6.0, -10.0), "1")
    code: ClassVar[int] = kernel.OGDEN
    measure: ClassVar[int] = kernel.ISOCHORIC
    needs_axes: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if len(self.mu) != len(self.alpha) or not self.mu:
            raise SceneError(
                f"Ogden: {len(self.mu)} values of mu for {len(self.alpha)} of alpha, expected as many "
                "of each, at least one"
            )
        for mu, alpha in zip(self.mu, self.alpha, strict=True):
            require(self, "mu_p alpha_p", mu * alpha, above=0.0)

    def parameters(self) -> tuple[float, ...]:
        """Return the number of terms, then mu [Pa] and alpha of each."""
        pairs = zip(self.mu, self.alpha, strict=True)
        return (float(len(self.mu)), *(value for pair in pairs for value in pair))

    def energy(self, C: Array, axes: Array) -> float:
        """Sum over terms of mu/alpha (tr Cbar^(alpha/2) - 3)."""
        squared = np.linalg.eigvalsh(C)
        terms = zip(self.mu, self.alpha, strict=True)
        return sum(mu / a * float((squared ** (0.5 * a)).sum() - 3.0) for mu, a in terms)


@dataclass(frozen=True)
@real_numbers
class Fung(Parametric):
    """Orthotropic exponential law of the skin, along the material axes a_i of the element.

    w = (c/2)(e^Q - 1), Q = (1/4c) [sum_i 2 mu_i (L_i - 2 K_i + 1)
    + sum_ij lame_ij (K_i - 1)(K_j - 1)], K_i = a_i . Cbar a_i, L_i = a_i . Cbar^2 a_i.

    Notes
    -----
    Defaults: mature skin; half of them for young, twice for old skin, each with a bulk modulus of
    250 kPa. Source: values of the published face model with anisotropic skin; axis 1 is parallel to
    the relaxed skin tension lines.
    """

    #: shear moduli of the axes [Pa], positive
    mu: tuple[float, float, float] = quantity((17773.0, 5931.0, 5931.0), "Pa", above=0.0)
    lame: tuple[float, float, float, float, float, float] = quantity(
        (1e3, 1e3, 1e3, 1e3, 1e3, 1e3), "Pa"
    )  #: Lame moduli 11, 22, 33, 12, 23, 31 [Pa]
    #: stress scale of the exponential [Pa], positive; a smaller scale stiffens at smaller strains
    c: float = quantity(3784.0, "Pa", above=0.0)
    code: ClassVar[int] = kernel.FUNG
    measure: ClassVar[int] = kernel.ISOCHORIC
    needs_axes: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if len(self.mu) != 3 or len(self.lame) != 6:
            raise SceneError(
                f"Fung: {len(self.mu)} values of mu and {len(self.lame)} of lame, expected 3 and 6"
            )
        super().__post_init__()

    def parameters(self) -> tuple[float, ...]:
        """C [Pa], mu [Pa], lame [Pa]."""
        return (self.c, *self.mu, *self.lame)

    def energy(self, C: Array, axes: Array) -> float:
        """Exponential of the quadratic form Q of the strains along the axes."""
        K, L = (np.diag(axes.T @ A @ axes) for A in (C, C @ C))
        l11, l22, l33, l12, l23, l31 = self.lame
        lame = np.array([[l11, l12, l31], [l12, l22, l23], [l31, l23, l33]])
        Q = 2.0 * np.array(self.mu) @ (L - 2.0 * K + 1.0) + (K - 1.0) @ lame @ (K - 1.0)
        return 0.5 * self.c * float(np.expm1(Q / (4.0 * self.c)))


@dataclass(frozen=True)
class _YoungPoisson(Parametric):
    """Isotropic moduli."""

    young: float = quantity(15e3, "Pa", above=0.0)  #: Young's modulus [Pa], positive
    #: Poisson's ratio [1], -1 < poisson < 0.5
    poisson: float = quantity(0.45, "1", above=-1.0, below=0.5)

    def parameters(self) -> tuple[float, ...]:
        """Lame's first modulus and the shear modulus [Pa]."""
        shear = self.young / (2.0 * (1.0 + self.poisson))
        return (2.0 * shear * self.poisson / (1.0 - 2.0 * self.poisson), shear)


@dataclass(frozen=True)
class LinearElastic(_YoungPoisson):
    """Hooke's law of the small strain eps, W = mu eps:eps + lame/2 (tr eps)^2.

    Only for small rotations, because a rotation causes a strain.
    """

    code: ClassVar[int] = kernel.LINEAR
    measure: ClassVar[int] = kernel.SMALL_STRAIN
    needs_axes: ClassVar[bool] = False

    def energy(self, C: Array, axes: Array) -> float:
        """Quadratic energy of eps = (C - I)/2."""
        lame, mu = self.parameters()
        eps = 0.5 * (C - np.eye(3))
        return mu * float((eps**2).sum()) + 0.5 * lame * float(np.trace(eps)) ** 2


@dataclass(frozen=True)
class CoRotational(_YoungPoisson):
    """Hooke's law in co-rotated axes, W = mu |U - I|^2 + lame/2 (tr U - 3)^2.

    With F = R U the stress is P = R (2 mu (U - I) + lame tr(U - I) I): the linear law in axes that
    rotate with R, at every Gauss point. U and that stress commute, so that P is the derivative of W
    and energy is conserved. The tangent is the exact derivative of P, including that of R. (The
    source omits that of R: the forces are the same, the iterates differ.)

    Notes
    -----
    Source: Mueller and Gross 2004, Interactive virtual materials (stiffness warping by the polar
    decomposition), the method of the first vocal tract models (Fels et al., Developing
    physically-based vocal tract models). There R belongs to a tetrahedron; with one Gauss point
    `tet4` is that element, and hexahedra and wedges have one R per Gauss point. The law is linear
    in compression, so that no energy barrier prevents inversion.
    """

    code: ClassVar[int] = kernel.CO_ROTATIONAL
    measure: ClassVar[int] = kernel.FINITE
    needs_axes: ClassVar[bool] = False

    def energy(self, C: Array, axes: Array) -> float:
        """Quadratic energy of U - I, whose principal values are those of C^(1/2) - I."""
        lame, mu = self.parameters()
        x = np.sqrt(np.linalg.eigvalsh(C)) - 1.0
        return mu * float((x**2).sum()) + 0.5 * lame * float(x.sum()) ** 2


TENSOR_LAWS: tuple[type[TensorLaw], ...] = (
    FiveTermMooneyRivlin,
    Ogden,
    Fung,
    LinearElastic,
    CoRotational,
)
"""All laws of the strain tensor, which the tests of derivatives, symmetry and frames include."""
