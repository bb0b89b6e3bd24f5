"""Passive tissue: law, bulk law and relaxation."""

from dataclasses import dataclass, field

from sim._kernels import tensor_laws
from sim.checks import real_numbers, require
from sim.errors import SceneError
from sim.laws import (
    TENSOR_LAWS,
    BulkLaw,
    IsochoricLaw,
    MooneyRivlin,
    Prony,
    QuadraticBulk,
    TensorLaw,
)


@dataclass(frozen=True)
@real_numbers
class Material:
    """Passive tissue."""

    law: IsochoricLaw | TensorLaw = field(default_factory=MooneyRivlin)
    #: pointwise law of the volume. None: `QuadraticBulk` with an isochoric law, and none with a law
    #: that determines the volume change itself (`LinearElastic`, `CoRotational`)
    bulk: BulkLaw | None = None
    density: float = 1040.0  #: rest density [kg/m^3], positive
    #: viscoelastic relaxation of the stress of the law; the bulk law is elastic
    relaxation: Prony | None = None

    def __post_init__(self) -> None:
        require(self, "density", self.density, above=0.0)
        if self._is_isochoric:
            if self.bulk is None:
                object.__setattr__(self, "bulk", QuadraticBulk())
        elif self.bulk is not None:
            raise SceneError(
                f"Material: {type(self.law).__name__} determines the volume change itself, "
                "expected no separate bulk law: use bulk=None"
            )

    @property
    def _is_isochoric(self) -> bool:
        if isinstance(self.law, TENSOR_LAWS):
            return self.law.measure == tensor_laws.ISOCHORIC
        return True

    @property
    def kappa(self) -> float:
        """Bulk modulus of the pointwise bulk law [Pa]."""
        return 0.0 if self.bulk is None else self.bulk.kappa

    @property
    def bulk_code(self) -> int:
        """Code of the bulk law; arbitrary if there is none."""
        return 0 if self.bulk is None else self.bulk.code

    @property
    def needs_axes(self) -> bool:
        """True if the law depends on the material axes of the element."""
        return isinstance(self.law, TENSOR_LAWS) and self.law.needs_axes

    @property
    def tensor_form(self) -> tuple[int, int, tuple[float, ...]] | None:
        """Measure, code and parameters for the second element loop; None for the first.

        The first loop is only for elastic laws of one scalar.
        """
        law = self.law
        if isinstance(law, TENSOR_LAWS):
            return law.measure, law.code, law.parameters()
        if self.relaxation is None:
            return None
        return tensor_laws.ISOCHORIC, tensor_laws.ISOCHORIC_FIRST + law.code, law.parameters()
