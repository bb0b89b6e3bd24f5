"""Rows of extreme materials and elements: stiff volume, stiff layers, slivers, mass ratios."""

from collections.abc import Iterator

from benchmarks.integrators import EXPLICIT, IMPLICIT, STATIC
from benchmarks.stability.bodies import FULL, MODERATE, Block, driven
from benchmarks.stability.trial import Trial
from sim import FixedStep, HalvingStep

STEP = HalvingStep(0.01)
EXPLICIT_STEP = FixedStep(5e-5)
"""Step [s] of about a fifth of the stability limit of the block of soft tissue."""


def both(
    row: int,
    title: str,
    case: str,
    block: Block,
    parameter: str,
    value: float,
    *,
    full: bool = False,
    static: bool = True,
) -> Iterator[Trial]:
    """One case for the implicit schemes, and undamped and short for the explicit ones.

    Stiffness-proportional damping limits explicit steps so strongly that it would hide other
    limits.
    """
    drive = driven(FULL, 0.01) if full else driven(MODERATE, 0.1)
    yield Trial(
        row, title, case, block.system, drive, 0.2, STEP,
        IMPLICIT | (STATIC if static else {}), parameter, value,
    )  # fmt: skip
    free = block.but(damped=False)
    yield Trial(
        row, title, f"{case}, undamped, 0.05 ms", free.system, drive, 0.01, EXPLICIT_STEP,
        dict(EXPLICIT), f"{parameter}, undamped, 0.05 ms", value,
    )  # fmt: skip


def bulk_moduli() -> Iterator[Trial]:
    """Row 1: bulk modulus from 25 kPa to 250 MPa, with every treatment of the volume."""
    title = "bulk modulus x 1 ... 1e4"
    for volume in ("pointwise", "element", "nodal"):
        for factor in (1, 10, 100, 1000, 10000):
            block = Block(kappa=25e3 * factor, volume=volume)
            case, parameter = f"{volume} x {factor}", f"bulk modulus [kPa], {volume}"
            yield from both(1, title, case, block, parameter, 25.0 * factor)
    hard = Block(volume="hard")
    yield Trial(1, title, "hard", hard.system, driven(MODERATE, 0.1), 0.2, STEP, IMPLICIT | STATIC)


def stiff_layers() -> Iterator[Trial]:
    """Row 2: one layer stiffer by up to 1e4, and softer."""
    title = "one layer stiffer by 0.01 ... 1e4"
    for factor in (0.01, 0.1, 10, 100, 1000, 10000):
        block = Block(stiff=factor)
        yield from both(2, title, f"x {factor:g}", block, "stiffness of one layer [1]", factor)


def slivers() -> Iterator[Trial]:
    """Row 7: flat elements, and elements with a nearly inverted corner."""
    title = "sliver elements"
    for factor in (0.1, 0.02, 0.007, 0.001):
        block = Block(squeezed=factor)
        yield from both(7, title, f"height x {factor:g}", block, "height of a layer [1]", factor)
    for jacobian in (0.1, 0.007, 1e-3, 1e-5):
        block = Block(corner=jacobian)
        case = f"scaled Jacobian {jacobian:g}"
        yield from both(7, title, case, block, "scaled Jacobian of a corner [1]", jacobian)


def masses() -> Iterator[Trial]:
    """Row 8: mass ratio of the uppermost layer 1e-6 ... 1e6, without the load of its weight."""
    for factor in (1e-6, 1e-3, 1e3, 1e6):
        block = Block(dense=factor, gravity=0.0)
        title, parameter = "mass ratio 1e-6 ... 1e6", "mass ratio of a layer [1]"
        yield from both(8, title, f"{factor:g}", block, parameter, factor, static=False)
