"""Sentences for a report on the limits of a study of simulated volunteers."""

import xarray as xr

CAN = (
    "A study of simulated volunteers shows whether the chain from recording to score is "
    "implemented as specified, how much the scores depend on its choices, and how they "
    "decrease where a stated assumption of the method is violated."
)
CANNOT = (
    "It cannot show how well the method predicts the motion of people. sEMG, motion and "
    "anatomy are computed by models with chosen parameters, which do not contain all "
    "properties of people. Scores and tests in this report do not apply to people."
)
MATCHED_SENTENCE = (
    "In the matched world, the volunteers satisfy the assumptions of the study: their "
    "motion is computed with the laws of the study, force follows sEMG without delay, and "
    "electrodes record the combinations of muscles that the mapping of Eqs 2-6 resolves. "
    "Scores close to 1 are therefore expected."
)
REL_MATCHED = (
    "Only muscles in the table of relevant muscles, which act_rel also uses, are active. "
    "act_rel therefore contains the true selection of muscles by construction, and its "
    "advantage over the other strategies is not a finding."
)
OTHER_SENTENCE = (
    "These volunteers belong to the {world}. The sizes of their differences from the "
    "assumptions of the study were chosen. The scores show the effects of differences of "
    "these sizes; they do not show how large such differences are in people."
)
REL_OTHER = (
    "The volunteers' movements are still derived from the table of relevant muscles that "
    "act_rel uses, although persons omit, add and weight muscles individually. act_rel "
    "therefore has an advantage that it may not have in people."
)
UNLABELLED = (
    "The recordings do not state how the volunteers differ from the assumptions of the "
    "study; they may belong to a matched world, in which the method is tested against "
    "itself."
)


def simulated_limits(cube: xr.Dataset) -> list[str]:
    """Return sentences on the limits of simulated recordings; none for measured ones.

    The attributes ``origin`` and ``world`` of the cube are used.
    """
    if cube.attrs.get("origin") != "simulated":
        return []
    world = str(cube.attrs.get("world", ""))
    sentences = [CAN, CANNOT]
    if not world:
        return [*sentences, UNLABELLED]
    matched = world == "matched world"
    sentences.append(MATCHED_SENTENCE if matched else OTHER_SENTENCE.format(world=world))
    if "act_rel" in cube["strategy"].values:
        sentences.append(REL_MATCHED if matched else REL_OTHER)
    return sentences
