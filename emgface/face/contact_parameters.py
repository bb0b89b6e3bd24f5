"""Parameters of the contact of lips and teeth."""

from typing import Final, Literal

from pydantic import model_validator

from emgface.choices import ESKES, STAVNESS, Parameters, choice, parameter


class ContactParameters(Parameters):
    """Contact of the lips with each other, and of lips and cheeks with teeth and bone."""

    method: Literal["none", "constraint"] = choice(
        "constraint",
        "'constraint': compressive forces prevent nodes from passing the opposite surface; "
        "'none': surfaces pass through each other.",
        source=f"{STAVNESS}, Contact handling",
        note="'constraint' takes about ten times as long as 'none' where surfaces touch",
    )
    between: tuple[Literal["lips", "teeth"], ...] | None = choice(
        None,
        "Surfaces that may touch: 'lips' (each other), 'teeth' (lips and cheeks); default: both, if "
        "the face has them.",
        source=f"{STAVNESS}, Contact handling",
        note="if `support` represents the teeth, the default is the lips alone",
    )
    friction: float = parameter(
        0.0,
        "Coulomb friction coefficient between tissues and between tissue and teeth.",
        source=f"{ESKES}, Finite element face model (frictionless)",
        ge=0,
        le=2,
    )

    initial_penetration: Literal["kept", "removed"] = choice(
        "kept",
        "Treatment of nodes that start inside bone: 'kept': they may keep their depth or "
        "move outwards; 'removed': they are moved out at removal_speed.",
    )
    removal_speed: float = parameter(
        0.01,
        "Speed at which nodes that start inside bone are moved out.",
        unit="m/s",
        note="1 mm takes 0.1 s",
        gt=0,
        le=1,
    )

    renewals: int | None = parameter(
        None,
        "Largest number of times in a step that the normals and closest points of contacts are "
        "replaced by those at its end; default: 1 with 'sdirk2' and 'converged', 0 with linearly "
        "implicit solvers, which do not iterate.",
        source="this package: points measured by `python -m benchmarks contact_methods`",
        note="in 20 trials from EMG, 1 reduced the error to 0.6 of that with 0, for 1.2 times the run "
        "time (docs/accuracy.md); a finished study of an earlier version, which lacks this, has 0",
        ge=0,
        le=3,
    )

    @model_validator(mode="after")
    def _something_touches(self) -> "ContactParameters":
        if self.between is None:
            return self
        if not self.between or len(set(self.between)) < len(self.between):
            raise ValueError(
                f"between = {list(self.between)}: expected 'lips', 'teeth' or both, each "
                "once; method = 'none' switches contact off"
            )
        return self

    def renewals_with(self, solver: str) -> int:
        """Number of renewals as specified, or that of a solver."""
        if self.renewals is not None:
            return self.renewals
        return 0 if solver.startswith("linearly_implicit") else 1

    def methods_phrase(self, solver: str) -> str:
        """Phrase on the contact for the methods of a manuscript."""
        pairs = {
            "lips": "of the lips with each other",
            "teeth": "of lips and cheeks with the teeth",
        }
        rubbing = f"friction {self.friction:g}" if self.friction else "frictionless"
        how = {
            "none": "none",
            "constraint": "node-to-face constraints",
        }
        if self.method == "constraint" and self.initial_penetration == "removed":
            how["constraint"] += f", initial overlap removed at {1e3 * self.removal_speed:g} mm/s"
        if self.method == "constraint" and self.renewals_with(solver):
            how["constraint"] += ", with the normals and closest points at the end of a step"
        where = " and ".join(pairs[name] for name in self.between or pairs)
        where += "" if self.between else ", where the face has them"
        return f"contact {where} ({how[self.method]}, {rubbing})"


NO_CONTACT: Final = ContactParameters(method="none")
"""Contact switched off: surfaces pass through each other."""
