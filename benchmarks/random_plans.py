"""Random plans of treatment over generated faces: how they end, and the longest time.

    python -m benchmarks treatment --only random --plans 200

Every plan is treated, or refused with a reason (`emgface.errors.TreatmentError`); simulated data.
"""

import time
from typing import Any

import numpy as np

import emgface as ef
import sim
from benchmarks.report import Row
from emgface.api.given import simulation_of, study_of
from emgface.errors import EmgfaceError, FaceError, TreatmentError
from emgface.face.lips import lining
from emgface.face.motion import settle_face
from emgface.face.template.build import volunteer_face


def random(plans: int = 20, seed: int = 0) -> list[Row]:
    """Random plans over generated faces: how they end, and the longest time."""
    rng = np.random.default_rng(seed)
    free = simulation_of(study_of(None).simulation, "draft", {"contact": {"method": "none"}})
    faces = [volunteer_face(2017, k + 1, resolution="coarse")[0] for k in range(min(20, plans))]
    ended: dict[str, int] = {}
    silent, longest, unstated, closed = 0, 0.0, 0, 0
    for k in range(plans):
        plan = random_plan(rng)
        start = time.process_time()
        try:
            treated = ef.treat(faces[k % len(faces)], plan)
            settle_face(treated, free)
            if all(step.get("layers", "all") == "all" for step in plan["step"]):
                lining(treated)  # the surfaces that contact requires, of wounds without a pocket
                closed += 1
            how = "unchanged" if treated is faces[k % len(faces)] else "treated"
        except TreatmentError as error:
            how = f"refused: {error.reason}"
        except FaceError as error:
            how = f"defect: {type(error).__name__}"
            silent += 1
            print(plan, error)
        except EmgfaceError as error:
            how = f"other: {type(error).__name__}"
            unstated += 1
            print(plan, error)
        except sim.SimulationError as error:
            how = f"equilibrium under gravity: {type(error).__name__}"
            silent += 1
            print(plan, error)
        except Exception as error:  # a defect, which is counted
            how = f"defect: {type(error).__name__}"
            silent += 1
            print(plan, repr(error))
        ended[how] = ended.get(how, 0) + 1
        longest = max(longest, time.process_time() - start)
    return [
        (f"{plans} random plans over {len(faces)} faces",
         "; ".join(f"{v} {k}" for k, v in sorted(ended.items())), "treated, or a sentence", silent == 0),
        ("refusals without a reason that programs can read", str(unstated), "0", unstated == 0),
        ("plans of all layers whose lips have surfaces for contact", str(closed), "all treated",
         silent == 0),
        ("longest", f"{longest:.1f} s", "no hang", longest < 120.0),
    ]  # fmt: skip


def random_plan(rng: np.random.Generator) -> dict[str, Any]:
    """Random plan of one to three steps, also with sizes that no lip has."""
    steps: list[dict[str, Any]] = []
    for kind in rng.choice(["wedge", "wedge", "wedge", "tumour", "incision", "change", "palsy"],
                           rng.integers(1, 4)):  # fmt: skip
        lip = str(rng.choice(["lower", "lower", "upper"]))
        cut = {"lip": lip, "place": float(rng.uniform(0.05, 0.95)),
               "rejoin": str(rng.choice(["all", "none"]))}  # fmt: skip
        if kind == "wedge":
            cut |= {"shape": str(rng.choice(["V", "W", "shield", "rectangle"])),
                    "width": float(rng.uniform(0.0, 35.0)), "height": float(rng.uniform(2.0, 25.0)),
                    "method": str(rng.choice(["conforming", "elements"])),
                    "layers": str(rng.choice(["all", "all", "outer", "outer and centre"]))}  # fmt: skip
        elif kind == "tumour":
            centre = [float(rng.uniform(-30, 30)), 98.0, float(rng.uniform(-15, 15))]
            radii = [float(r) for r in rng.uniform(1.0, 6.0, 3)]
            cut = {"lip": lip, "centre": centre, "radii": radii}
        elif kind == "incision":
            cut["height"] = float(rng.uniform(1.0, 15.0))
        elif kind == "change":
            cut = {
                "lip": lip,
                "stiffness": float(rng.uniform(0.3, 5.0)),
                "strength": float(rng.uniform(0, 1)),
            }
        else:
            cut = {"side": str(rng.choice(["left", "right"])), "degree": float(rng.uniform(0, 1))}
        steps.append({"kind": str(kind), **cut})
    return {"step": steps}
