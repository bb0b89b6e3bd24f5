"""Kinematics: coordinates of a scene, and the motion of points that they determine."""

from sim.kinematics.contract import Kinematics
from sim.kinematics.layout import lay_out_kinematics
from sim.kinematics.members import (
    MEMBERS,
    Fixed,
    InElement,
    Member,
    OnBody,
    PrescribedBody,
    PrescribedNodes,
)

__all__ = [
    "MEMBERS",
    "Fixed",
    "InElement",
    "Kinematics",
    "Member",
    "OnBody",
    "PrescribedBody",
    "PrescribedNodes",
    "lay_out_kinematics",
]
