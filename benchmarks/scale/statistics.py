"""Time and memory of all tests of a study, against the number of volunteers."""

import resource
import time
from typing import Any

from analysis.statistics.simulated import simulated_scores
from analysis.statistics.summary import conclusions, study_statistics

VOLUNTEERS = (50, 200, 1000, 10_000)


def statistics() -> list[dict[str, Any]]:
    """Apply all tests to simulated scores of six instructions, four repetitions and five markers."""
    rows: list[dict[str, Any]] = []
    for volunteers in VOLUNTEERS:
        cube = simulated_scores(
            1, volunteers=volunteers, instructions=6, repetitions=4, markers=5,
            effects=(0.0, 0.02, 0.05), sd_instruction_strategy=0.1,
        )  # fmt: skip
        began = time.process_time()
        sentences = conclusions(study_statistics(cube))
        rows.append({
            "volunteers": volunteers, "trials": volunteers * 72,
            "processor time [s]": time.process_time() - began,
            "largest memory so far [MB]": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
        })  # fmt: skip
        print(sentences[-1])
    return rows
