"""Joints: rows over velocities of bodies and points, bilateral or unilateral, rigid or compliant."""

from sim.joints.contract import Joint, Row
from sim.joints.joints import (
    JOINTS,
    Bushing,
    Cylindrical,
    Limit,
    Planar,
    PointOnCurve,
    PointOnPlane,
    Prismatic,
    Revolute,
    Spherical,
    Weld,
)

__all__ = [
    "JOINTS",
    "Bushing",
    "Cylindrical",
    "Joint",
    "Limit",
    "Planar",
    "PointOnCurve",
    "PointOnPlane",
    "Prismatic",
    "Revolute",
    "Row",
    "Spherical",
    "Weld",
]
