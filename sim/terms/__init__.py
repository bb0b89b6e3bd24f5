"""Terms: sources of force, one file each."""

from sim.scene import Term
from sim.terms.axial_springs import AxialSprings
from sim.terms.crushable import Crushable
from sim.terms.line_muscle import LineMuscles
from sim.terms.load import Gravity, NodeLoad
from sim.terms.material import Material
from sim.terms.muscles import Muscles
from sim.terms.nodal_volume import NodalVolume
from sim.terms.of_blocks import OfBlocks
from sim.terms.solid import Solid
from sim.terms.stiffening import Stiffening
from sim.terms.strands import LineFibre
from sim.terms.support import Support
from sim.terms.volume import ElementVolume

TERMS: tuple[type[Term], ...] = (
    Solid,
    Gravity,
    ElementVolume,
    NodalVolume,
    LineMuscles,
    AxialSprings,
    NodeLoad,
    Stiffening,
    Support,
)
"""All terms with a potential, the members of the derivative tests."""

__all__ = [
    "TERMS",
    "AxialSprings",
    "Crushable",
    "ElementVolume",
    "Gravity",
    "LineFibre",
    "LineMuscles",
    "Material",
    "Muscles",
    "NodalVolume",
    "NodeLoad",
    "OfBlocks",
    "Solid",
    "Stiffening",
    "Support",
]
