"""Term of some element blocks of a mesh that joins several parts, such as face and tongue."""

from dataclasses import dataclass, replace

from sim.checks import real_numbers
from sim.mesh import Mesh
from sim.scene import CompiledTerm, Index, Layout, Term
from sim.state import Array


@dataclass(frozen=True, eq=False)
@real_numbers
class OfBlocks(Term):
    """A term that sees some blocks of the mesh; its elements are counted from the first of them.

    Nodes keep their numbers in the mesh.

    Attributes
    ----------
    term : Term
    first, last : int
        First block, and the one after the last.
    """

    term: Term
    first: int
    last: int

    @property
    def label(self) -> str:
        """Name in the memory of states, which does not depend on the order of terms."""
        own = getattr(self.term, "label", type(self.term).__name__)
        return f"{own} of blocks {self.first}-{self.last - 1}"

    def node_mass(self, mesh: Mesh) -> Array:
        """Mass of the term."""
        return self.term.node_mass(mesh.of_blocks(self.first, self.last))

    def muscle_names(self) -> tuple[str, ...]:
        """Muscles of the term."""
        return self.term.muscle_names()

    def pair_keys(self, mesh: Mesh) -> Index:
        """Pairs of the term."""
        return self.term.pair_keys(mesh.of_blocks(self.first, self.last))

    def compile(self, layout: Layout) -> CompiledTerm:
        """Compile the term for these blocks."""
        part = layout.mesh.of_blocks(self.first, self.last)
        return self.term.compile(replace(layout, mesh=part))
