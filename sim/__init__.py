"""sim: total-Lagrangian soft-tissue mechanics. The folder listing is the equation."""

from sim.constraints import HardElementVolume
from sim.damping import PassiveRayleigh, Rayleigh, RestRayleigh
from sim.displace import displace_held
from sim.embedding import Embedding, embed
from sim.errors import (
    ControlError,
    InvertedElement,
    MeshError,
    NotConverged,
    SceneError,
    SimulationError,
    SingularSystem,
)
from sim.integrators import (
    ConvergedEuler,
    LinearlyImplicitEuler,
    LinearlyImplicitTrapezoidal,
    RungeKutta4,
    Sdirk2,
    Static,
    SymplecticEuler,
    Trapezoidal,
    Workspace,
)
from sim.laws import (
    Blemker,
    Constant,
    ConstantForce,
    Generic,
    LogarithmicBulk,
    MooneyRivlin,
    NeoHooke,
    Peck,
    QuadraticBulk,
)
from sim.mesh import Mesh, mesh_from_arrays
from sim.prestretch import IN_VIVO, initial_stretch, stretch_field
from sim.probes import Energies, Iterations, Markers, Opening, Positions, SmallestJ
from sim.reductions import Fixed
from sim.scene import Scene
from sim.simulate import Activation, resting, simulate
from sim.state import Control, ControlAt, State, StepReport
from sim.steps import ErrorControlledStep, FixedStep, HalvingStep
from sim.system import System, compile_scene
from sim.terms import (
    ElementVolume,
    Gravity,
    LineFibre,
    LineMuscles,
    Material,
    Muscles,
    NodalVolume,
    NodeLoad,
    Solid,
    Stiffening,
    Support,
)

__all__ = [
    "Activation",
    "Blemker",
    "Constant",
    "ConstantForce",
    "Control",
    "ControlAt",
    "ControlError",
    "ConvergedEuler",
    "ElementVolume",
    "ErrorControlledStep",
    "Embedding",
    "Energies",
    "Fixed",
    "FixedStep",
    "Generic",
    "Gravity",
    "HalvingStep",
    "HardElementVolume",
    "IN_VIVO",
    "InvertedElement",
    "Iterations",
    "LineFibre",
    "LineMuscles",
    "LinearlyImplicitEuler",
    "LinearlyImplicitTrapezoidal",
    "LogarithmicBulk",
    "Markers",
    "Material",
    "Mesh",
    "MeshError",
    "MooneyRivlin",
    "Muscles",
    "NeoHooke",
    "NodalVolume",
    "NodeLoad",
    "NotConverged",
    "Opening",
    "PassiveRayleigh",
    "Peck",
    "Positions",
    "QuadraticBulk",
    "Rayleigh",
    "RestRayleigh",
    "RungeKutta4",
    "Scene",
    "SceneError",
    "Sdirk2",
    "SimulationError",
    "SingularSystem",
    "SmallestJ",
    "Solid",
    "State",
    "Static",
    "StepReport",
    "Stiffening",
    "Support",
    "SymplecticEuler",
    "System",
    "Trapezoidal",
    "Workspace",
    "compile_scene",
    "displace_held",
    "embed",
    "initial_stretch",
    "mesh_from_arrays",
    "resting",
    "simulate",
    "stretch_field",
]
