"""Kinematics: coordinates of a scene, and the motion of points that they determine."""

from sim.kinematics.contract import Kinematics
from sim.kinematics.selection import Selection

__all__ = ["Kinematics", "Selection"]
