"""Joints, walls and stops of the generated jaw, and the membranes of its larynx."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from emgface.anatomy.jaw.model import JawJoint, JawLine
from emgface.anatomy.jaw.template.measures import EMINENCE_SLOPE, OCCLUSAL_CANT, JawMeasures
from emgface.anatomy.jaw.template.muscles import MIRROR, place

Floats = NDArray[np.float64]

POSTERIOR_PLAY, LATERAL_PLAY = 0.7e-3, 1.0e-3
"""Ways of a condyle from intercuspation to the posterior and lateral walls of its fossa [m]: the
retruded position lies about 1 mm behind intercuspation, and the side shift of a lateral movement is
about 1 mm (Posselt 1952; Bennett 1908; as commonly quoted)."""
STRANDS = 6
"""Strands of a membrane on each side."""
STRAND_STIFFNESS = 650.0
"""Stiffness of one strand [N/m]: 12 strands as stiff as the 20 of 385.6 N/m of the published model
(Stavness et al. 2006)."""
LIGAMENT_STIFFNESS = 200.0
"""Stiffness of the stylohyoid ligament and the pharynx behind the hyoid [N/m], as published there."""
STRAND_DAMPING = 1e-3
LIGAMENTS = {"capsule": (("condyle", 0, -12, 4), ("condyle", 0, -3, -4), 1.6, 12e3)}
"""Ends, free length over that at rest, and stiffness [N/m] of ligaments. The capsule and the tissue
behind the disc run from the posterior edge of the fossa to the neck of the condyle (Standring, Gray's
Anatomy) and limit protrusion; length and stiffness are chosen so that it is within the norms."""


def path_depth(way: float, length: float) -> float:
    """Depth of the condylar path below its start [m] after a horizontal distance [m].

    A parabola of slope tan 40 degrees at the start, level at the crest of the eminence.
    """
    s = min(way, length)
    return float(np.tan(np.radians(EMINENCE_SLOPE)) * (s - 0.5 * s * s / length))


def joints(places: Mapping[str, Floats], jaw: JawMeasures) -> list[JawJoint]:
    """Condylar paths, walls and the plane of the teeth of both sides, and the cricothyroid hinge.

    The condyles stay on their paths in both directions, as the capsule and the disc hold them there.
    """
    slope = np.radians(EMINENCE_SLOPE)
    forward = np.array([0.0, np.cos(slope), -np.sin(slope)])
    cant = np.radians(OCCLUSAL_CANT)
    down = np.array([0.0, -np.sin(cant), -np.cos(cant)])
    guides = list[JawJoint]()
    for side, mirror in MIRROR.items():
        condyle, molar = places["condyle"] * mirror, places["molar"] * mirror
        point = f"condyle{side}"
        first = float(np.tan(slope))
        inward = np.array([-1.0, 0.0, 0.0]) * mirror
        guides += [
            JawJoint(
                f"tmj{side}",
                "curve",
                "skull",
                condyle,
                (0.0, 0.0, -1.0),
                point,
                one_sided=False,
                coefficients=(0.0, first, -0.5 * first / jaw.eminence_length, 0.0),
                length=jaw.eminence_length,
            ),
            JawJoint(
                f"posterior{side}",
                "plane",
                "skull",
                condyle - POSTERIOR_PLAY * forward,
                forward,
                point,
            ),
            JawJoint(
                f"lateral{side}", "plane", "skull", condyle - LATERAL_PLAY * inward, inward, point
            ),
            JawJoint(f"bite{side}", "plane", "skull", molar, down, f"bite{side}"),
        ]
    hinge = places["joint"] * [0.0, 1.0, 1.0]
    guides.append(JawJoint("cricothyroid", "hinge", "thyroid", hinge, (1.0, 0.0, 0.0), "cricoid"))
    return guides


def springs(places: Mapping[str, Floats], jaw: JawMeasures) -> list[JawLine]:
    """Membranes of the larynx, suspension of the hyoid, ligaments of the mandible; at rest as built."""
    hyoid, horn, notch, cricoid = (places[n] for n in ("hyoid", "horn", "notch", "cricoid"))
    half, ring = 0.5 * jaw.thyroid_width, 0.5 * jaw.cricoid_diameter
    lines = list[JawLine]()
    for side in MIRROR:
        for k in range(STRANDS):
            s = (k + 0.5) / STRANDS
            upper = hyoid + s * (horn - hyoid) + [0.0, 0.0, -3e-3]
            lower = notch + s * np.array([half, -jaw.thyroid_depth, 2e-3])
            lines.append(_spring(f"thyrohyoid{k}", side, ("hyoid", "thyroid"), upper, lower))
            t = np.pi * s
            low = cricoid + [ring * np.sin(t), ring * np.cos(t), -4e-3]
            end = low + [0.0, 0.0, -30e-3]
            lines.append(_spring(f"cricotracheal{k}", side, ("cricoid", "sternum"), low, end))
        styloid = places["condyle"] + [-14e-3, -7e-3, -28e-3]
        wall = horn + [6e-3, -12e-3, 10e-3]
        for name, end in (("stylohyoid", styloid), ("pharynx", wall)):
            start = hyoid + [11e-3, -5e-3, 1e-3] if name == "stylohyoid" else horn
            body = ("hyoid", "skull" if name == "stylohyoid" else "sternum")
            lines.append(_spring(name, side, body, start, end, LIGAMENT_STIFFNESS))
        for name, (origin, insertion, free, stiffness) in LIGAMENTS.items():
            ends = place(places, origin), place(places, insertion)
            lines.append(
                _spring(name, side, ("skull", "jaw"), *ends, stiffness, free, one_sided=True)
            )
    return lines


def _spring(
    name: str,
    side: str,
    bodies: tuple[str, str],
    start: Floats,
    end: Floats,
    stiffness: float = STRAND_STIFFNESS,
    free: float = 1.0,
    *,
    one_sided: bool = False,
) -> JawLine:
    ends = np.array([start, end]) * MIRROR[side]
    values = {
        "stiffness": stiffness,
        "rest_length": free * float(np.linalg.norm(ends[1] - ends[0])),
        "damping": STRAND_DAMPING,
        "one_sided": float(one_sided),
    }
    return JawLine(name + side, bodies, ends, values)
