"""Experiments that explain why published statements are not reproduced on the generated head.

Rings that draw the lips back, with and without stiffening; superficial rings that leave the lips open;
and labials whose muscles pull with the published forces instead of the published levels.
"""

import itertools
from collections.abc import Callable, Iterator, Mapping
from typing import Final

from emgface.anatomy.head.sweep import PlannedRun, Setting, outcomes
from emgface.face.muscle_parameters import SIGMA_MAX
from studies.coupled.experiments import FACE, LABIALS, LAW, STIFF, Experiment, with_teeth
from studies.coupled.findings import Finding, Results, Value, every, labial_findings

BACK: Final = ("intermediate middle", "marginal superficial")
"""Rings that draw the lips of this face back, by up to 1 mm."""
STRONG: Final = {"sigma_max": 3.0 * SIGMA_MAX}
RINGS: Final = ("marginal", "intermediate", "peripheral")
FORCES: Final[Mapping[str, tuple[float, float]]] = {
    "OOP": (2.1, 7.8), "OOM": (1.0, 2.55), "MEN": (2.0, 9.1), "LLSAN": (2.0, 9.2), "RIS": (1.0, 7.9),
}  # fmt: skip
"""Force at level 1 of a ring, or of a muscle of one side, in the published coupled model and in the
generated coarse face of an adult [N]: 1 N per line there, otherwise 100 kPa on the volume of the
elements over the length of the fibres."""


def _faces() -> Iterator[PlannedRun]:
    for ring, factor in itertools.product(BACK, (1.0, 10.0)):
        words, law = {"OOP": ring}, {**LAW, "stiffening": factor}
        yield PlannedRun(f"{ring}, factor {factor:g}", {"bi_OOP": 0.5}, law, rings=words)
    for factor in (1.0, 10.0):
        words, law = {"OOP": "peripheral superficial"}, {**STRONG, "stiffening": factor}
        name = f"strong ring, no teeth, factor {factor:g}"
        yield PlannedRun(name, {"bi_OOP": 1.0}, law, rings=words, contacts=("lip-lip",))
    for ring in RINGS:
        words = {"OOP": f"{ring} superficial"}
        yield PlannedRun(f"{ring} superficial, OOP 0.05", {"bi_OOP": 0.05}, STIFF, rings=words)
    yield PlannedRun("rest", {}, LAW)
    for name in ("closure", "fricative", "approximant"):
        levels = {
            f"bi_{m}": round(level * FORCES[m][0] / FORCES[m][1], 3)
            for m, level in LABIALS[name].items()
        }
        yield PlannedRun(f"equal forces {name}", levels, LAW)
        one = levels | {"bi_OOP": min(1.0, round(3.0 * levels["bi_OOP"], 3))}
        words = {"OOP": "peripheral middle"}
        yield PlannedRun(f"middle layer {name}", one, LAW, rings=words)


def _open() -> Iterator[PlannedRun]:
    for ring in RINGS:
        drive = {"bi_OOP": 0.5, "bi_open": 0.1}
        words = {"OOP": f"{ring} superficial"}
        yield PlannedRun(f"{ring} superficial", drive, STIFF, rings=words, contacts=("lip-lip",))


def _explained(at: Results) -> Iterator[Finding]:
    plain, stiff = (at(f"strong ring, no teeth, factor {f}", "protrusion_mm") for f in (1, 10))
    yield Finding(
        "Stiffening moves the lips forward: superficial ring that draws them back strongly (300 kPa)",
        f"protrusion {plain} mm without, {stiff} mm with a factor of 10",
        every(Value(0.0, 0.0).above(plain), stiff.above(plain)),
    )
    yield _grows(at, "Superficial, with the lips nearly as at rest (level 0.05)", ", OOP 0.05")
    yield from labial_findings(at, "equal forces ", "published forces")
    yield from labial_findings(at, "middle layer ", "published forces and layer")


def _grows(at: Results, what: str, ending: str) -> Finding:
    area, width = (
        [at(f"{ring} superficial{ending}", name) for ring in (RINGS[0], RINGS[-1])]
        for name in ("area_mm2", "width_mm")
    )
    return Finding(
        f"{what}: the area grows with the width of the mouth",
        f"area {area[0]} to {area[1]} mm², width {width[0]} to {width[1]} mm, marginal to peripheral",
        every(width[1].above(width[0]), area[1].above(area[0])),
    )


def _wide(at: Results) -> Iterator[Finding]:
    yield _grows(at, "Superficial, with an open jaw (openers 0.1)", "")


_LIPS: Final = ("opening_mm", "area_mm2", "width_mm", "protrusion_mm")
EXPLAINED: Final[Mapping[str, Experiment]] = {
    "explained": Experiment(
        "8 Causes of the differences: rings, levels and forces",
        tuple(_faces()),
        (*_LIPS, "lower_to_teeth_mm", "smallest_J", "speed_mm_s"),
        ("protrusion_mm", "area_mm2", "lower_to_teeth_mm"),
        FACE,
        with_teeth,
    ),
    "open": Experiment(
        "9 Causes of the differences: superficial rings with an open jaw",
        tuple(_open()),
        ("lower_incisor_up_mm", *_LIPS, "smallest_J", "speed_mm_s"),
        ("opening_mm", "area_mm2", "width_mm"),
        Setting(parts=("face", "jaw"), step=2e-2),
        outcomes,
    ),
}
EXPLANATIONS: Final[Mapping[str, Callable[[Results], Iterator[Finding]]]] = {
    "explained": _explained,
    "open": _wide,
}
